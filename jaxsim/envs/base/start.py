"""Models of the tasks, and random states to start from."""

import functools

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, PRNGKeyArray

from jaxsim.io import bundled_xml, load
from jaxsim.model import Model, State, make_state


def load_asset(name: str, **options) -> Model:
    """The bundled model of this name, even if a file has the same name; loaded only once.

    Args:
      name: one of `jaxsim.io.bundled_models()`.
      options: arguments of `jaxsim.load`.
    """
    return _load_asset(name, jax.dtypes.canonicalize_dtype(float).name, **options)


@functools.cache
def _load_asset(name: str, dtype: str, **options) -> Model:
    with jax.ensure_compile_time_eval():  # a model is never part of a traced program
        return load(bundled_xml(name), **options)


def uniform(key: PRNGKeyArray, n: int, scale: float | Array) -> Float[Array, "n"]:
    """`n` numbers, each uniform in (-scale, scale)."""
    return scale * jax.random.uniform(key, (n,), minval=-1.0, maxval=1.0)


def uniform_start(
    model: Model, key: PRNGKeyArray, scale: float | Array, normal_velocity: bool = False
) -> State:
    """A random state near `qpos0` and near rest, as in most of Gymnasium's tasks.

    Args:
      model: the model.
      key: random key.
      scale: deviations of positions and velocities are uniform in (-scale, scale).
      normal_velocity: whether velocities are `scale` times the standard normal distribution
        instead.
    """
    pos_key, vel_key = jax.random.split(key)
    if normal_velocity:
        qvel = scale * jax.random.normal(vel_key, (model.nv,))
    else:
        qvel = uniform(vel_key, model.nv, scale)
    qpos = model.qpos0 + uniform(pos_key, model.nq, scale)
    return start_from(model, qpos, qvel)


def start_from(model: Model, qpos: Float[Array, "nq"], qvel: Float[Array, "nv"]) -> State:
    """A state with the given positions and velocities."""
    dtype = model.qpos0.dtype
    # Copies: the numbers may belong to an MjData that moves on.
    return make_state(model).replace(qpos=jnp.array(qpos, dtype), qvel=jnp.array(qvel, dtype))
