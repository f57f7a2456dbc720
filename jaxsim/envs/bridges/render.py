"""Frames for Gymnasium's `render_mode="rgb_array"`."""

import mujoco

from jaxsim.envs.base import Env
from jaxsim.io import build, bundled_models, bundled_xml
from jaxsim.viz import Frames

MODES = ("rgb_array",)


def checked_mode(mode: str | None) -> str | None:
    """The mode itself, if it exists.

    Raises:
      ValueError: it does not.
    """
    if mode is not None and mode not in MODES:
        raise ValueError(f'render_mode must be None or "rgb_array", got {mode!r}')
    return mode


def frames(env: Env, width: int, height: int, camera: int | str | None) -> Frames:
    """The renderer of an environment's states.

    A bundled task is drawn with the materials and cameras of its file, any other in plain colours.
    """
    return Frames(_source(env) or env.unwrapped.model, width, height, camera)


def _source(env: Env) -> mujoco.MjModel | None:
    """The compiled file of a bundled task, unless the environment has got another model since."""
    package, _, name = type(env.unwrapped).__module__.rpartition(".")
    if package != "jaxsim.envs" or name not in bundled_models():
        return None
    mj = mujoco.MjModel.from_xml_string(bundled_xml(name))
    return mj if build(mj).structure == env.unwrapped.model.structure else None
