"""Shapes of what `step`, `forward` and the like are given."""

import jax.numpy as jnp

from jaxsim.model import Model, State


def check_shapes(model: Model, state: State, ctrl) -> None:
    """Raise a ValueError that names the first array of another shape than the model has."""
    expected = {
        "qpos": (model.nq,),
        "qvel": (model.nv,),
        "act": (model.na,),
        "xfrc_applied": (model.nbody, 6),
        "qfrc_applied": (model.nv,),
        "mocap_pos": (model.nmocap, 3),
        "mocap_quat": (model.nmocap, 4),
    }
    for name, shape in expected.items():
        if jnp.shape(getattr(state, name)) != shape:
            raise ValueError(
                f"state.{name} must have shape {shape}, got {jnp.shape(getattr(state, name))}; "
                "batches go through jax.vmap or jaxsim.vmap"
            )
    if ctrl is not None and jnp.shape(ctrl) != (model.nu,):
        raise ValueError(
            f"ctrl must have shape ({model.nu},) or be None, got {jnp.shape(ctrl)}; batches go "
            "through jax.vmap or jaxsim.vmap"
        )
