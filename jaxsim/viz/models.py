"""A model as pictures want it: MuJoCo's for what it looks like, ours for its physics."""

import mujoco

from jaxsim.io import load, to_mujoco
from jaxsim.model import Model


def looks_of(model: Model | mujoco.MjModel) -> mujoco.MjModel:
    """MuJoCo's model, which has colours, meshes and cameras."""
    return to_mujoco(model) if isinstance(model, Model) else model


def physics_of(model: Model | mujoco.MjModel) -> Model:
    """The model that `jaxsim.forward` takes, with MuJoCo's law of contact if it is MuJoCo's."""
    return model if isinstance(model, Model) else load(model)
