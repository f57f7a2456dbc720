"""What a model predicts for a window, and its distance from what was measured."""

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.checkpoint import checkpoint
from jaxsim.engine import step
from jaxsim.joints.coordinates import difference_pos, integrate_pos
from jaxsim.model import Model, State, make_state
from jaxsim.sysid.recording import Windows


@struct.dataclass
class Noise:
    """Standard deviations of measurements, of each degree of freedom.

    Attributes:
      pos: of the coordinates, in their tangent space.
      vel: of the velocities.
    """

    pos: Float[Array, "nv"]
    vel: Float[Array, "nv"]


def predict(
    model: Model, window: Windows, start: Float[Array, "2*nv"], substeps: int
) -> tuple[Float[Array, "L nq"], Float[Array, "L nv"]]:
    """Coordinates and velocities at the samples of one window.

    Args:
      model: the model.
      window: one window, without the leading axis.
      start: what is added to the measured first coordinates, in their tangent space, and to the
        measured first velocity.
      substeps: time steps between two samples.
    """
    move, push = jnp.split(start, 2)
    first = make_state(model).replace(
        qpos=integrate_pos(model, window.qpos[0], move, 1.0),
        qvel=window.qvel[0] + push,
        act=window.act,
    )
    once = checkpoint(lambda state, ctrl: step(model, state, ctrl))

    def to_next_sample(state: State, ctrl):
        state, _ = lax.scan(lambda s, _: (once(s, ctrl), None), state, None, length=substeps)
        return state, (state.qpos, state.qvel)

    _, later = lax.scan(to_next_sample, first, window.ctrl)
    pairs = zip((first.qpos, first.qvel), later, strict=True)
    qpos, qvel = (jnp.concatenate([x[None], xs]) for x, xs in pairs)
    return qpos, qvel


def residual(
    model: Model,
    window: Windows,
    qpos: Float[Array, "L nq"],
    qvel: Float[Array, "L nv"],
    noise: Noise,
) -> Float[Array, "L 2*nv"]:
    """Prediction minus measurement in standard deviations, zero for what does not count."""
    away = jax.vmap(lambda a, b: difference_pos(model, a, b))(window.qpos, qpos)
    drift = (qvel - window.qvel) * window.has_qvel
    both = jnp.concatenate([away / noise.pos[None], drift / noise.vel[None]], axis=1)
    return both * window.weight[:, None]
