"""`State`: the variables that a step takes and returns."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.model.errors import expect
from jaxsim.model.history import initial_history
from jaxsim.model.model import Model


@struct.dataclass
class State:
    """The state of one environment; layout and signs are MuJoCo's.

    It contains nothing that can be recomputed, except `qacc_warmstart`, from which the next
    constraint solve starts.

    Attributes:
      qpos: positions; quaternions are (w, x, y, z).
      qvel: velocities, in the tangent space of `qpos`.
      act: activations of actuators with dynamics.
      time: time in seconds.
      qacc_warmstart: acceleration of the last step.
      xfrc_applied: external (force, torque) on each body at its centre of mass, world axes.
      qfrc_applied: external generalised forces.
      mocap_pos: positions of the mocap bodies.
      mocap_quat: orientations of the mocap bodies; normalised when used.
      time_excess: `time`, which is rounded up, minus the exact time. Steps maintain it, so that a
        float32 time neither drifts nor stops. Zero if it is not given, or if its shape differs
        from that of `time`.
      history: samples of delayed controls and sensors, see `jaxsim.model.history`; None in a model
        without delays.
    """

    qpos: Float[Array, "nq"]
    qvel: Float[Array, "nv"]
    act: Float[Array, "na"]
    time: Float[Array, ""]
    qacc_warmstart: Float[Array, "nv"]
    xfrc_applied: Float[Array, "nbody 6"]
    qfrc_applied: Float[Array, "nv"]
    mocap_pos: Float[Array, "nmocap 3"]
    mocap_quat: Float[Array, "nmocap 4"]
    time_excess: Float[Array, ""] = None  # type: ignore[assignment]
    history: Float[Array, "nhistory"] = None  # type: ignore[assignment]

    def __post_init__(self):
        # JAX also builds states whose fields are axes, types or None.
        if isinstance(self.time, jax.Array | np.ndarray | float):
            excess = self.time_excess
            if excess is None or np.shape(excess) != np.shape(self.time):
                object.__setattr__(self, "time_excess", 0 * self.time)


def make_state(model: Model, keyframe: int | str | None = None) -> State:
    """The state at `qpos0` and at rest, or at a keyframe.

    Args:
      model: the model.
      keyframe: index or name of one of the model's keyframes.

    Returns:
      A state of one environment; batches are made with `jax.vmap`.

    Raises:
      KeyError: no keyframe has this name.
      IndexError: there is no keyframe with this index.
      TypeError: the model is not a `Model`, or the keyframe is neither an index nor a name.
    """
    expect(model, Model, "jaxsim.load")
    dtype = model.qpos0.dtype
    bodies = model.structure.mocap_bodies
    state = State(
        qpos=jnp.asarray(model.qpos0),
        qvel=jnp.zeros(model.nv, dtype),
        act=jnp.zeros(model.na, dtype),
        time=jnp.zeros((), dtype),
        qacc_warmstart=jnp.zeros(model.nv, dtype),
        xfrc_applied=jnp.zeros((model.nbody, 6), dtype),
        qfrc_applied=jnp.zeros(model.nv, dtype),
        mocap_pos=model.body_pos[bodies],
        mocap_quat=model.body_quat[bodies],
        history=initial_history(model),  # type: ignore[arg-type]
    )
    if keyframe is None:
        return state
    k = _keyframe_index(model, keyframe)
    return state.replace(
        qpos=model.key_qpos[k],
        qvel=model.key_qvel[k],
        act=model.key_act[k],
        time=model.key_time[k],
        mocap_pos=model.key_mpos[k].reshape(-1, 3),
        mocap_quat=model.key_mquat[k].reshape(-1, 4),
    )


def _keyframe_index(model: Model, keyframe: int | str) -> int:
    if isinstance(keyframe, str):
        return model.names.id("key", keyframe)
    if isinstance(keyframe, bool) or not hasattr(keyframe, "__index__"):
        raise TypeError(f"keyframe must be an index or a name, got {type(keyframe).__name__}")
    if not 0 <= int(keyframe) < model.nkey:
        raise IndexError(f"the model has {model.nkey} keyframes, got keyframe {int(keyframe)}")
    return int(keyframe)
