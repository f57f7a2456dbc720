"""`to_mujoco`: a `Model` as a `mujoco.MjModel`, and a `State` as a `mujoco.MjData`."""

import copy
import dataclasses
from typing import overload

import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.io.cables import cable_leaf
from jaxsim.io.pid_controllers import pid_leaf
from jaxsim.model import Model, ModelError, State
from jaxsim.model.errors import expect
from jaxsim.model.history import time_places

_STATE = "qpos qvel act qacc_warmstart xfrc_applied qfrc_applied mocap_pos mocap_quat".split()
# Fields from which MuJoCo's compiler computes the bounding boxes of geoms.
_BOXES = "geom_size", "geom_pos", "geom_quat"
_MIDPHASE_OFF = int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE)


@overload
def to_mujoco(model: Model) -> mujoco.MjModel: ...
@overload
def to_mujoco(
    model: Model, state: State, ctrl: Float[Array, "nu"] | None = None
) -> tuple[mujoco.MjModel, mujoco.MjData]: ...
def to_mujoco(model: Model, state: State | None = None, ctrl: Float[Array, "nu"] | None = None):
    """Convert a model, and optionally a state, for MuJoCo's viewer, renderer and tools.

    The `MjModel` is a copy of the one from which the model was loaded, with its names, materials
    and meshes, and with the model's present numbers. A geom with a signed distance function is the
    geom of the file that stands in for it.

    Args:
      model: the model of one environment.
      state: a state of one environment, or None; `mj_forward` is called on its data.
      ctrl: controls in the data; zeros if None.

    Returns:
      The `MjModel`, or `(MjModel, MjData)` if a state is given.

    Raises:
      ModelError: a number has changed that MuJoCo can change only by compiling the MJCF again.
      TypeError: the model is not a `Model`, or the state not a `State`.
      ValueError: the model or the state has a batch axis.
    """
    expect(model, Model, "jaxsim.load")
    if state is not None:
        expect(state, State, "jaxsim.make_state")
    mj = copy.copy(model.structure.source)
    model = _with_stand_ins(model, mj)
    _check_simple_bodies(model, mj)
    _check_meshes(model, mj)
    _check_plugins(model, mj)
    moved = any(not np.array_equal(getattr(mj, n), _numbers(model, n)) for n in _BOXES)
    for record, target in ((model, mj), (model.opt, mj.opt), (model.stat, mj.stat)):
        for field in dataclasses.fields(record):
            value = getattr(record, field.name)
            known = value is not None and not dataclasses.is_dataclass(value)
            if known and hasattr(target, field.name):
                _assign(target, field.name, value)
    # The compiler's marks of frames that coincide may be wrong for the present numbers.
    for kind in "body", "geom", "site":
        getattr(mj, f"{kind}_sameframe")[:] = int(mujoco.mjtSameFrame.mjSAMEFRAME_NONE)
    if moved:
        mj.opt.disableflags |= _MIDPHASE_OFF
    return mj if state is None else (mj, _data(model, mj, state, ctrl))


def _with_stand_ins(model: Model, mj: mujoco.MjModel) -> Model:
    """The model with the sizes of the geoms that stand in for signed distance functions."""
    if not model.sdf:
        return model
    own = (np.asarray(model.geom_type) != mj.geom_type)[:, None]
    return model.replace(geom_size=np.where(own, mj.geom_size, _numbers(model, "geom_size")))


def _data(model: Model, mj: mujoco.MjModel, state: State, ctrl) -> mujoco.MjData:
    data = mujoco.MjData(mj)
    for name in _STATE:
        _assign(data, name, getattr(state, name))
    data.time = float(state.time) - float(state.time_excess)
    if state.history is not None:
        _assign(data, "history", state.history)
        data.history[time_places(model)] += data.time
    if ctrl is not None:
        _assign(data, "ctrl", ctrl)
    mujoco.mj_forward(mj, data)
    return data


def _assign(target, name: str, value) -> None:
    """Assign to an attribute: in place if it is an array."""
    value, old = np.asarray(value), getattr(target, name)
    if value.shape != np.shape(old):
        raise ValueError(
            f"to_mujoco takes one environment: {name} must have shape {np.shape(old)}, got "
            f"{value.shape}; take one of a batch with jax.tree.map(lambda x: x[i], ...)"
        )
    if isinstance(old, np.ndarray):
        old[...] = value
    else:
        setattr(target, name, value.item())


def _numbers(model: Model, name: str) -> np.ndarray:
    return np.asarray(getattr(model, name), float)


def _check_simple_bodies(model: Model, mj: mujoco.MjModel) -> None:
    """Raise if a body that MuJoCo takes for aligned with its inertial frame no longer is."""
    simple = mj.body_simple[1:] > 0
    frames = np.concatenate([_numbers(model, "body_ipos"), _numbers(model, "body_iquat")], axis=1)
    off = np.abs(frames[1:] - [0, 0, 0, 1, 0, 0, 0]).max(1) > 0
    for body in 1 + np.nonzero(simple & off)[0]:
        raise ModelError(
            f"{model.names.label('body', int(body))}: its centre of mass or inertial axes have "
            "left the body's frame, which MuJoCo has compiled in; change the MJCF instead"
        )


def _check_meshes(model: Model, mj: mujoco.MjModel) -> None:
    """Raise if the size of a mesh has changed: MuJoCo's collision does not scale its vertices."""
    changed = ~np.isclose(_numbers(model, "geom_size"), mj.geom_size, 1e-6, 0).all(axis=1)
    for geom in np.nonzero(changed & (mj.geom_type == mujoco.mjtGeom.mjGEOM_MESH))[0]:
        raise ModelError(
            f"{model.names.label('geom', int(geom))}: the size of its mesh has changed, which "
            "MuJoCo has compiled in; change the scale in the MJCF instead"
        )


def _check_plugins(model: Model, mj: mujoco.MjModel) -> None:
    """Raise if a number of a plugin has changed: MuJoCo has it as text."""
    for leaf, kind in ((cable_leaf(mj), "body"), (pid_leaf(mj), "actuator")):
        for name, numbers in leaf.items():
            same = np.isclose(_numbers(model, name), numbers, 1e-6, 0).all(axis=1)
            for row in np.flatnonzero(~same):
                raise ModelError(
                    f"{model.names.label(kind, int(row))}: its {name} has changed, which MuJoCo "
                    "has compiled in; change the configuration of the plugin in the MJCF instead"
                )
