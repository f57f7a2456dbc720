"""The static half of a model: every integer that decides a shape or a branch.

`Structure` compares and hashes by content, so two models that differ only in numbers share one
compilation.
"""

import functools
import hashlib
from typing import Any

import mujoco
import numpy as np

from jaxsim.model.compound import Compound
from jaxsim.model.names import Names
from jaxsim.model.topology import Forest

SIZES = (
    "nq nv nu na nbody njnt ngeom nsite ncam neq ntendon nwrap nsensor nsensordata nmocap nkey "
    "npair nexclude nactuator nout nhistory"
).split()

ARRAYS = (
    "body_parentid body_rootid body_weldid body_mocapid body_jntnum body_jntadr body_dofnum "
    "body_dofadr body_simple dof_jntid "
    "jnt_type jnt_qposadr jnt_dofadr jnt_bodyid jnt_limited jnt_actfrclimited jnt_actgravcomp "
    "geom_type geom_contype geom_conaffinity geom_condim geom_bodyid geom_priority geom_group "
    "site_type site_bodyid cam_bodyid cam_targetbodyid cam_mode cam_projection cam_resolution "
    "pair_dim pair_geom1 pair_geom2 exclude_signature "
    "eq_type eq_obj1id eq_obj2id eq_objtype eq_active0 "
    "tendon_adr tendon_num tendon_limited tendon_actfrclimited wrap_type wrap_objid "
    "actuator_trntype actuator_dyntype actuator_gaintype actuator_biastype actuator_trnid "
    "actuator_ctrladr actuator_ctrlnum actuator_ctrlspec actuator_outadr actuator_outnum "
    "actuator_actadr actuator_actnum actuator_actlimited actuator_actearly actuator_ctrllimited "
    "actuator_forcelimited actuator_group actuator_history actuator_historyadr "
    "sensor_type sensor_datatype sensor_objtype sensor_objid sensor_reftype "
    "sensor_refid sensor_dim sensor_adr sensor_intprm sensor_history sensor_historyadr"
).split()

# Fields with a row for each control or force of an actuator, and the field that counts them.
ACTUATOR_ROWS = {
    "actuator_ctrlrange": "actuator_ctrlnum",
    **dict.fromkeys(("actuator_gear", "actuator_acc0"), "actuator_outnum"),
    **dict.fromkeys(("actuator_length0", "actuator_lengthrange"), "actuator_outnum"),
}


class Structure:
    """Sizes, types, addresses, flags and names of a model, immutable and hashable.

    Fields have MuJoCo's names and values; arrays are read-only NumPy arrays. `nhistory` is zero
    without delays. Fields of our own are the tables of hulls, height fields and actuators
    (`jaxsim.io.hulls`, `jaxsim.io.fields`, `jaxsim.io.actuators`), `wrap_sideid`, the side site of
    each surface that a tendon wraps around (-1: none), `geom_opaque`, whether each geom is opaque,
    `geom_ellipsoid`, whether it is an ellipsoid for the medium, and `jnt_limits_meet` and
    `tendon_limits_meet`, whether both ends of a range may be active at once. The link tree (`tree`)
    and the body tree (`body_tree`) are derived from the fields. `facts` caches the facts that other
    packages declare (see `jaxsim.model.facts`). The compiled `source` is used for drawing, for rays
    against its meshes and by `to_mujoco`. It does not take part in comparisons, except that a
    digest of its meshes is a field.
    """

    def __init__(
        self,
        sizes: dict[str, int],
        arrays: dict[str, np.ndarray],
        names: Names,
        source: mujoco.MjModel,
        **extra: Any,
    ):
        self.source = source
        self._fields: dict[str, Any] = {**sizes, **arrays, **extra}
        self.names = names
        self.facts: dict[str, Any] = {}
        digest = hashlib.sha256(repr((sizes, sorted(extra.items()), names.key)).encode())
        for name, value in arrays.items():
            value.setflags(write=False)
            digest.update(f"{name}{value.shape}{value.dtype}".encode() + value.tobytes())
        self._digest = digest.digest()

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return self._fields[name]
        except KeyError:
            raise AttributeError(f"a model has no attribute {name!r}") from None

    def __dir__(self):
        return [*super().__dir__(), *self._fields]

    def __hash__(self) -> int:
        return hash(self._digest)

    def __eq__(self, other) -> bool:
        return isinstance(other, Structure) and self._digest == other._digest

    def __repr__(self) -> str:
        return f"Structure(nq={self.nq}, nv={self.nv}, nu={self.nu}, nbody={self.nbody})"

    @functools.cached_property
    def tree(self) -> Forest:
        """The link tree: one link for each joint; a node's kind is the type of its joint."""
        ndof = np.bincount(self.dof_jntid, minlength=self.njnt)
        return Forest(self._link_parent(), np.asarray(self.jnt_type, int), ndof)

    @functools.cached_property
    def body_tree(self) -> Forest:
        """The tree of all bodies; the world is its root."""
        parent = np.asarray(self.body_parentid, int).copy()
        parent[0] = -1
        return Forest(parent)

    @functools.cached_property
    def mocap_bodies(self) -> np.ndarray:
        """(nmocap,) mocap bodies, in the order of `mocap_pos`."""
        bodies = np.flatnonzero(self.body_mocapid >= 0)
        return bodies[np.argsort(self.body_mocapid[bodies])]

    @functools.cached_property
    def weld_tree(self) -> Forest:
        """The body tree cut at jointed and mocap bodies: each tree of this forest is rigid."""
        parent = np.asarray(self.body_parentid, int).copy()
        parent[(self.body_jntnum > 0) | (self.body_mocapid >= 0)] = -1
        parent[0] = -1
        return Forest(parent)

    @functools.cached_property
    def body_carrier(self) -> np.ndarray:
        """(nbody,) jointed or mocap body, or the world, at the root of each body's weld tree."""
        forest = self.weld_tree
        return forest.order[forest.root[forest.position]]

    @functools.cached_property
    def body_link(self) -> np.ndarray:
        """(nbody,) link, in tree order, that carries each body; -1 for the world or mocap."""
        carrier = self.body_carrier
        last = self.body_jntadr[carrier] + self.body_jntnum[carrier] - 1
        moving = self.body_jntnum[carrier] > 0
        return np.where(
            moving, self.tree.position[np.where(moving, last, 0)] if self.njnt else -1, -1
        )

    @functools.cached_property
    def link_first(self) -> np.ndarray:
        """(njnt,) in tree order, whether the link's joint is the first of its body."""
        joints = self.tree.order
        return np.asarray(self.body_jntadr[self.jnt_bodyid[joints]] == joints)

    @functools.cached_property
    def dof_order(self) -> np.ndarray:
        """(nv,) MuJoCo's index of each degree of freedom in tree order."""
        starts = self.jnt_dofadr[self.tree.order]
        parts = [s + np.arange(n) for s, n in zip(starts, self.tree.ndof, strict=True)]
        return np.concatenate([np.zeros(0, int), *parts]).astype(int)

    @functools.cached_property
    def dof_position(self) -> np.ndarray:
        """(nv,) index in tree order of each degree of freedom in MuJoCo's order."""
        return np.argsort(self.dof_order)

    @functools.cached_property
    def ctrl_actuator(self) -> np.ndarray:
        """(nu,) actuator of each control."""
        return np.repeat(np.arange(self.nactuator), self.actuator_ctrlnum)

    @functools.cached_property
    def out_actuator(self) -> np.ndarray:
        """(nout,) actuator of each force."""
        return np.repeat(np.arange(self.nactuator), self.actuator_outnum)

    @functools.cached_property
    def act_actuator(self) -> np.ndarray:
        """(na,) actuator of each activation."""
        (ids,) = np.nonzero(self.actuator_actnum)
        ids = ids[np.argsort(self.actuator_actadr[ids])]
        return np.repeat(ids, self.actuator_actnum[ids])

    @functools.cached_property
    def related_dofs(self) -> np.ndarray:
        """(nv, nv) whether one of two degrees of freedom moves the other's link."""
        moves = self.tree.moves[self.tree.dof_node][:, self.dof_position][self.dof_position]
        return moves | moves.T

    @functools.cached_property
    def compound(self) -> Compound:
        """The link tree with all joints of a body merged into one."""
        return Compound.of(self.tree, self.link_first)

    def _link_parent(self) -> np.ndarray:
        """(njnt,) parent joint of each joint, -1 at the root of a tree."""
        parent = np.full(self.njnt, -1, int)
        carrier = self.body_carrier
        for j in range(self.njnt):
            body = self.jnt_bodyid[j]
            if j > self.body_jntadr[body]:
                parent[j] = j - 1
                continue
            above = carrier[self.body_parentid[body]]
            if self.body_jntnum[above] > 0:
                parent[j] = self.body_jntadr[above] + self.body_jntnum[above] - 1
        return parent
