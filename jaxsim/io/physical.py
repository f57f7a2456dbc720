"""Validation of a compiled model's numbers: which are physically impossible."""

import dataclasses
from collections.abc import Iterator

import jax.numpy as jnp
import mujoco
import numpy as np

from jaxsim.arrays.constants import MINVAL
from jaxsim.model.model import Model, Option
from jaxsim.model.names import Label
from jaxsim.model.problems import ModelProblem, rows
from jaxsim.model.structure import ACTUATOR_ROWS

# Kind of element for the prefix of a field's name.
_KINDS = {
    "body": "body",
    "jnt": "joint",
    "geom": "geom",
    "site": "site",
    "cam": "camera",
    "pair": "pair",
    "eq": "equality",
    "tendon": "tendon",
    "actuator": "actuator",
    "sensor": "sensor",
    "key": "key",
}
# MJCF's names of attributes that differ from MuJoCo's names of fields.
_MJCF_NAMES = {
    "jnt_solref": "solreflimit",
    "jnt_solimp": "solimplimit",
    "jnt_actfrcrange": "actuatorfrcrange",
    "dof_solref": "solreffriction",
    "dof_solimp": "solimpfriction",
    "tendon_solref_lim": "solreflimit",
    "tendon_solimp_lim": "solimplimit",
    "tendon_solref_fri": "solreffriction",
    "tendon_solimp_fri": "solimpfriction",
    "tendon_actfrcrange": "actuatorfrcrange",
    "tendon_lengthspring": "springlength",
    "body_ipos": "pos of the inertial frame",
    "body_iquat": "quat of the inertial frame",
    "wrap_prm": "coef",
    "qpos_spring": "springref",
}
_NOT_NEGATIVE = (
    *("body_mass", "body_inertia", "body_gravcomp", "dof_frictionloss", "tendon_frictionloss"),
    *("geom_gap", "pair_gap", "geom_adhesion", "pair_adhesion"),
)


def impossible(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """All numbers in a compiled model that are not finite or physically impossible."""
    yield from _not_finite(mj, label)
    if not mj.opt.timestep > 0:
        yield ModelProblem("option", f"timestep must be positive, got {mj.opt.timestep:g}")
    for medium in ("density", "viscosity"):
        if getattr(mj.opt, medium) < 0:
            yield ModelProblem("option", f"{medium} must not be negative")
    for field in _NOT_NEGATIVE:
        for i in rows(getattr(mj, field) < 0):
            yield ModelProblem(
                _element(mj, label, field, i), f"{_attribute(field)} must not be negative"
            )
    yield from _triangle(mj, label)
    yield from _moving_mass(mj, label)


def _element(mj: mujoco.MjModel, label: Label, field: str, i: int) -> str:
    """Label of the element to which row i of a field belongs."""
    prefix = field.split("_")[0]
    if prefix == "dof":
        return label("joint", int(mj.dof_jntid[i]))
    if prefix in ("qpos0", "qpos"):
        return label("joint", int(np.searchsorted(mj.jnt_qposadr, i, side="right")) - 1)
    if prefix == "wrap":
        return label("tendon", int(np.searchsorted(mj.tendon_adr, i, side="right")) - 1)
    if field in ACTUATOR_ROWS:
        i = int(np.repeat(np.arange(mj.nactuator), getattr(mj, ACTUATOR_ROWS[field]))[i])
    return label(_KINDS[prefix], i)


def _attribute(field: str) -> str:
    """MJCF's name for a field."""
    return _MJCF_NAMES.get(field, field.partition("_")[2] or field)


def _not_finite(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """Numbers that are not finite in JAX's default float type."""
    for field in dataclasses.fields(Model):
        value = getattr(mj, field.name, None)
        if isinstance(value, np.ndarray) and value.size and field.metadata.get("pytree_node", True):
            for i in rows(~_finite(value)):
                yield ModelProblem(
                    _element(mj, label, field.name, i), f"{_attribute(field.name)} is not finite"
                )
    for field in dataclasses.fields(Option):
        if not np.all(_finite(getattr(mj.opt, field.name))):
            yield ModelProblem("option", f"{field.name} is not finite")


def _finite(value) -> np.ndarray:
    with np.errstate(over="ignore"):
        return np.isfinite(np.asarray(value).astype(jnp.result_type(float)))


def _triangle(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """Principal moments that violate the triangle inequality."""
    for b in range(1, mj.nbody):
        inertia = mj.body_inertia[b]
        # Slack for rounding: a flat body meets the bound exactly.
        if min(inertia) >= 0 and 2 * inertia.max() > inertia.sum() * (1 + 1e-4):
            yield ModelProblem(
                label("body", b),
                f"inertia {inertia.tolist()} breaks the triangle inequality; no principal moment "
                "may exceed the sum of the other two",
            )


def _moving_mass(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """Jointed bodies whose subtree has no mass, so that the mass matrix is singular."""
    carried = np.zeros(mj.nbody)
    np.add.at(carried, mj.body_weldid, mj.body_mass)
    below = carried.copy()
    for b in range(mj.nbody - 1, 0, -1):
        below[mj.body_parentid[b]] += below[b]
    for b in np.nonzero(mj.body_jntnum > 0)[0]:
        start = mj.body_dofadr[b]
        armature = mj.dof_armature[start : start + mj.body_dofnum[b]]
        if below[b] < MINVAL and (armature < MINVAL).any():
            yield ModelProblem(
                label("body", int(b)), "a moving body needs mass, or armature on its joints"
            )
