"""What a model may ask for, and which numbers are physically possible.

Everything that MuJoCo would use and this package would not is an error here: nothing is ignored
silently. Rendering data (cameras, lights, materials, visual meshes) has no effect on the physics
and passes.
"""

from collections.abc import Callable, Iterable

import mujoco
import numpy as np

from jaxsim.arrays.constants import MINVAL
from jaxsim.model.errors import ModelError

INTEGRATORS = ("EULER", "RK4", "IMPLICIT", "IMPLICITFAST")
TRANSMISSIONS = ("JOINT", "JOINTINPARENT", "TENDON", "SITE")
DYNAMICS = ("NONE", "INTEGRATOR", "FILTER", "FILTEREXACT", "MUSCLE")
GAINS = ("FIXED", "AFFINE", "MUSCLE")
BIASES = ("NONE", "AFFINE", "MUSCLE")
EQUALITIES = ("CONNECT", "WELD", "JOINT", "TENDON")
UNSUPPORTED_SENSORS = (
    "RANGEFINDER CAMPROJECTION GEOMDIST GEOMNORMAL GEOMFROMTO CONTACT TACTILE PLUGIN USER"
).split()
UNSUPPORTED_ENABLE = {
    "INVDISCRETE": "inverse dynamics is continuous-time",
    "SLEEP": "every body is simulated at every step",
    "DIAGEXACT": "the constraint inertia is the usual diagonal approximation",
    "IPC": "flexes are not simulated",
}


def check_supported(mj: mujoco.MjModel) -> None:
    """Raise `ModelError` naming the first thing in the model that is not supported."""
    names = _Labels(mj)
    _check_options(mj)
    _check_sizes(mj)
    _check_enum(
        mj.actuator_trntype, "mjTRN_", "mjtTrn", TRANSMISSIONS, "transmission", names.actuator
    )
    _check_enum(mj.actuator_dyntype, "mjDYN_", "mjtDyn", DYNAMICS, "dyntype", names.actuator)
    _check_enum(mj.actuator_gaintype, "mjGAIN_", "mjtGain", GAINS, "gaintype", names.actuator)
    _check_enum(mj.actuator_biastype, "mjBIAS_", "mjtBias", BIASES, "biastype", names.actuator)
    _check_enum(mj.eq_type, "mjEQ_", "mjtEq", EQUALITIES, "equality type", names.equality)
    _check_zero(mj.actuator_delay, names.actuator, "delay", "remove the attribute")
    _check_zero(mj.actuator_history, names.actuator, "history", "remove the attribute")
    _check_zero(mj.actuator_ctrlnum - 1, names.actuator, "more than one control", "use one each")
    _check_zero(mj.geom_fluid[:, 0], names.geom, "fluidshape", "use the inertia-box fluid model")
    _check_zero(mj.geom_surfacevel, names.geom, "surfacevel", "remove the attribute")
    _check_zero(mj.geom_adhesion, names.geom, "adhesion", "remove the attribute")
    _check_zero(mj.pair_adhesion, names.pair, "adhesion", "remove the attribute")
    _check_zero(mj.tendon_armature, names.tendon, "armature", "put armature on the joints")
    on_tendon = mj.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON
    _check_zero(
        mj.actuator_armature * on_tendon,
        names.actuator,
        "armature of a tendon's actuator",
        "put armature on the joints",
    )
    _check_tendons(mj, names)
    _check_limits(mj, names)
    _check_sensors(mj, names)


class _Labels:
    """`labels.geom(3)` is how a message refers to geom 3."""

    def __init__(self, mj: mujoco.MjModel):
        self._mj = mj

    def __getattr__(self, kind: str) -> Callable[[int], str]:
        obj = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")

        def label(index: int) -> str:
            name = mujoco.mj_id2name(self._mj, obj, int(index))
            return f"{kind} {name!r}" if name else f"{kind} number {index}"

        return label


def _enum_names(enum: str, prefix: str, known: Iterable[str]) -> dict[int, str]:
    return {int(getattr(getattr(mujoco, enum), prefix + name)): name.lower() for name in known}


def _enum_name(enum: str, prefix: str, value: int) -> str:
    return getattr(mujoco, enum)(int(value)).name.removeprefix(prefix).lower()


def _check_enum(values, prefix, enum, supported, what, label) -> None:
    known = _enum_names(enum, prefix, supported)
    for i, value in enumerate(values):
        if int(value) not in known:
            raise ModelError(
                f"{label(i)}: {what} {_enum_name(enum, prefix, value)!r} is not supported; "
                f"use one of {', '.join(known.values())}"
            )


def _check_zero(values, label, attribute: str, remedy: str) -> None:
    values = np.asarray(values)
    for i in np.nonzero(values.reshape(len(values), -1).any(axis=1))[0] if values.size else ():
        raise ModelError(f"{label(i)}: {attribute} is not supported; {remedy}")


def _check_options(mj: mujoco.MjModel) -> None:
    _check_enum(
        [mj.opt.integrator],
        "mjINT_",
        "mjtIntegrator",
        INTEGRATORS,
        "integrator",
        lambda _: "option",
    )
    if mj.opt.noslip_iterations:
        raise ModelError("option: noslip_iterations is not supported; set it to 0 and use impratio")
    for flag, why in UNSUPPORTED_ENABLE.items():
        if mj.opt.enableflags & int(getattr(mujoco.mjtEnableBit, f"mjENBL_{flag}")):
            raise ModelError(f"option flag: {flag.lower()} is not supported ({why}); disable it")


def _check_sizes(mj: mujoco.MjModel) -> None:
    for size, what in (("nflex", "flex"), ("nplugin", "plugin")):
        if getattr(mj, size):
            raise ModelError(f"{what} elements are not supported; remove them from the model")


def _check_tendons(mj: mujoco.MjModel, names: _Labels) -> None:
    joint = int(mujoco.mjtWrap.mjWRAP_JOINT)
    for t in range(mj.ntendon):
        path = mj.wrap_type[mj.tendon_adr[t] : mj.tendon_adr[t] + mj.tendon_num[t]]
        if (path != joint).any():
            raise ModelError(
                f"{names.tendon(t)}: spatial tendons are not supported; use a fixed tendon"
            )


def _check_limits(mj: mujoco.MjModel, names: _Labels) -> None:
    """One row serves both ends of a range, so both must not be active at once."""
    scalar = np.bincount(mj.dof_jntid, minlength=mj.njnt) == 1
    joints = mj.jnt_limited.astype(bool) & scalar, mj.jnt_range, mj.jnt_margin, names.joint
    tendons = mj.tendon_limited.astype(bool), mj.tendon_range, mj.tendon_margin, names.tendon
    for limited, bounds, margin, label in (joints, tendons):
        both = limited & (bounds[:, 1] - bounds[:, 0] < 2 * margin)
        for i in np.nonzero(both)[0]:
            raise ModelError(
                f"{label(int(i))}: margin {margin[i]:g} exceeds half of the range, so that both "
                "limits would be active at once; use a smaller margin"
            )


def _check_sensors(mj: mujoco.MjModel, names: _Labels) -> None:
    unsupported = _enum_names("mjtSensor", "mjSENS_", UNSUPPORTED_SENSORS)
    for s, kind in enumerate(mj.sensor_type):
        if int(kind) in unsupported:
            raise ModelError(
                f"{names.sensor(s)}: type {unsupported[int(kind)]!r} is not supported; remove it, "
                "the documentation's table of sensors lists the supported types"
            )
        if int(mujoco.mjtObj.mjOBJ_CAMERA) in (mj.sensor_objtype[s], mj.sensor_reftype[s]):
            raise ModelError(
                f"{names.sensor(s)}: sensors of cameras are not supported; attach it to a site"
            )
    for attribute in ("history", "delay", "interval"):
        _check_zero(
            getattr(mj, f"sensor_{attribute}"), names.sensor, attribute, "remove the attribute"
        )


def check_physics(model) -> None:
    """Raise `ModelError` naming the first element whose numbers are physically impossible.

    Args:
      model: a built `Model`, on the host.
    """
    label = model.names.label
    _check_finite(model, label)
    if not float(model.opt.timestep) > 0:
        raise ModelError(f"option: timestep must be positive, got {float(model.opt.timestep)}")
    mass, inertia = np.asarray(model.body_mass), np.asarray(model.body_inertia)
    for b in range(1, model.nbody):
        if mass[b] < 0 or (inertia[b] < 0).any():
            raise ModelError(f"{label('body', b)}: mass and inertia must not be negative")
        # Slack for rounding: a flat body meets the bound exactly.
        if 2 * inertia[b].max() > inertia[b].sum() * (1 + 1e-4):
            raise ModelError(
                f"{label('body', b)}: inertia {inertia[b].tolist()} breaks the triangle "
                "inequality; no principal moment may exceed the sum of the other two"
            )
    _check_moving_mass(model, mass, label)


def _check_finite(model, label) -> None:
    kinds = {"jnt": "joint", "eq": "equality"}
    kinds |= {k: k for k in "body geom site actuator tendon pair sensor key".split()}
    for name, value in vars(model).items():
        # What is not an array is static, or a group of its own.
        if not hasattr(value, "dtype") or np.isfinite(np.asarray(value)).all():
            continue
        bad = int(np.argwhere(~np.isfinite(np.asarray(value)))[0][0])
        kind = kinds.get(name.split("_")[0])
        element = label(kind, bad) if kind and value.ndim else f"entry {bad}"
        raise ModelError(f"{element}: {name} is not finite")
    for name, value in vars(model.opt).items():
        if not np.isfinite(np.asarray(value)).all():
            raise ModelError(f"option: {name} is not finite")


def _check_moving_mass(model, mass: np.ndarray, label) -> None:
    """Each leaf of the tree must carry inertia, or the mass matrix is singular."""
    carrier = model.structure.body_carrier
    carried = np.zeros(model.nbody)
    np.add.at(carried, carrier, mass)
    armature = np.asarray(model.dof_armature)
    for b in np.nonzero(model.body_jntnum > 0)[0]:
        subtree = _subtree(model.body_parentid, int(b))
        start = model.body_dofadr[b]
        dofs = slice(start, start + model.body_dofnum[b])
        if carried[subtree].sum() < MINVAL and (armature[dofs] < MINVAL).any():
            raise ModelError(
                f"{label('body', int(b))}: a moving body needs mass, or armature on its joints"
            )


def _subtree(parent: np.ndarray, body: int) -> np.ndarray:
    inside = np.zeros(len(parent), bool)
    inside[body] = True
    for b in range(body + 1, len(parent)):
        inside[b] = inside[parent[b]]
    return np.nonzero(inside)[0]
