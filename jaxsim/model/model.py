"""`Model`: the parameters of a robot and its world, which are constant during a simulation.

Numbers are leaves, so that every physical parameter can be vmapped and differentiated. Integers
and flags are static and stored in `Structure`. Both have MuJoCo's names, shapes, order and units:
`model.body_mass` is a leaf, `model.jnt_type` is a NumPy array.
"""

import dataclasses
from typing import TYPE_CHECKING, Any

from flax import struct
from jaxtyping import Array, Float

from jaxsim.model.backward import EXACT, Backward
from jaxsim.model.names import Names
from jaxsim.model.presence import NOTHING, OPTIONAL_FORCES, Presence, extended
from jaxsim.model.structure import Structure
from jaxsim.model.summary import summary

# Leaves that are None in a model without delays.
DELAYS = ("actuator_delay", "sensor_delay", "sensor_interval")


@struct.dataclass
class Option:
    """Physics options: the numbers of `mjOption` as leaves, its integers as static fields."""

    timestep: Float[Array, ""]
    impratio: Float[Array, ""]
    tolerance: Float[Array, ""]
    ls_tolerance: Float[Array, ""]
    gravity: Float[Array, "3"]
    wind: Float[Array, "3"]
    magnetic: Float[Array, "3"]
    density: Float[Array, ""]
    viscosity: Float[Array, ""]
    o_margin: Float[Array, ""]
    o_solref: Float[Array, "2"]
    o_solimp: Float[Array, "5"]
    o_friction: Float[Array, "5"]
    integrator: int = struct.field(pytree_node=False)
    cone: int = struct.field(pytree_node=False)
    iterations: int = struct.field(pytree_node=False)
    ls_iterations: int = struct.field(pytree_node=False)
    noslip_iterations: int = struct.field(pytree_node=False)
    disableflags: int = struct.field(pytree_node=False)
    enableflags: int = struct.field(pytree_node=False)
    disableactuator: int = struct.field(pytree_node=False)

    def disabled(self, flag: int) -> bool:
        """Whether a bit of `mujoco.mjtDisableBit` is set."""
        return bool(self.disableflags & int(flag))

    def enabled(self, flag: int) -> bool:
        """Whether a bit of `mujoco.mjtEnableBit` is set."""
        return bool(self.enableflags & int(flag))


@struct.dataclass
class Statistic:
    """Statistics of the model at the reference configuration, which the physics uses."""

    meaninertia: Float[Array, ""]
    meanmass: Float[Array, ""]


@struct.dataclass
class Model:
    """A compiled model.

    Change numbers with `model.replace(body_mass=...)`, or simulate many variants by vmapping over
    a model with a batch axis on some leaves. Call `jaxsim.set_const` afterwards if masses, sizes
    or poses have changed. Every integer field of `mjModel` that the physics uses (`nq`, `jnt_type`,
    `geom_bodyid`, ...) is a static attribute, too.

    The arguments of `jaxsim.load` are fields: how the constraint solver solves with its Hessian
    (`hessian`), the contact law (`contact`), which derivatives a step has (`backward`), the numbers
    of contact slots (`max_contacts`, for each kind of contact) and of geom pairs
    (`max_geom_pairs`, for each pair of shapes), how Runge-Kutta averages rotations (`rotations`),
    and signed distance functions with their parameters (`sdf`, by the name of a geom). Forces that
    are zero, such as dry friction or drag, are left out of compiled programs. `present` says which
    may be nonzero, and `replace` updates it; see `jaxsim.model.presence`.
    """

    structure: Structure = struct.field(pytree_node=False)
    opt: Option
    stat: Statistic
    qpos0: Float[Array, "nq"]
    qpos_spring: Float[Array, "nq"]
    body_pos: Float[Array, "nbody 3"]
    body_quat: Float[Array, "nbody 4"]
    body_ipos: Float[Array, "nbody 3"]
    body_iquat: Float[Array, "nbody 4"]
    body_mass: Float[Array, "nbody"]
    body_subtreemass: Float[Array, "nbody"]
    body_inertia: Float[Array, "nbody 3"]
    body_invweight0: Float[Array, "nbody 2"]
    body_gravcomp: Float[Array, "nbody"]
    body_cable: Float[Array, "nbody 3"]
    jnt_solref: Float[Array, "njnt 2"]
    jnt_solimp: Float[Array, "njnt 5"]
    jnt_pos: Float[Array, "njnt 3"]
    jnt_axis: Float[Array, "njnt 3"]
    jnt_stiffness: Float[Array, "njnt"]
    jnt_stiffnesspoly: Float[Array, "njnt npoly"]
    jnt_range: Float[Array, "njnt 2"]
    jnt_actfrcrange: Float[Array, "njnt 2"]
    jnt_margin: Float[Array, "njnt"]
    dof_solref: Float[Array, "nv 2"]
    dof_solimp: Float[Array, "nv 5"]
    dof_frictionloss: Float[Array, "nv"]
    dof_armature: Float[Array, "nv"]
    dof_damping: Float[Array, "nv"]
    dof_dampingpoly: Float[Array, "nv npoly"]
    dof_invweight0: Float[Array, "nv"]
    dof_M0: Float[Array, "nv"]
    geom_solmix: Float[Array, "ngeom"]
    geom_solref: Float[Array, "ngeom 2"]
    geom_solimp: Float[Array, "ngeom 5"]
    geom_size: Float[Array, "ngeom 3"]
    geom_rbound: Float[Array, "ngeom"]
    geom_pos: Float[Array, "ngeom 3"]
    geom_quat: Float[Array, "ngeom 4"]
    geom_friction: Float[Array, "ngeom 3"]
    geom_surfacevel: Float[Array, "ngeom 6"]
    geom_fluid: Float[Array, "ngeom 12"]
    geom_margin: Float[Array, "ngeom"]
    geom_gap: Float[Array, "ngeom"]
    geom_adhesion: Float[Array, "ngeom"]
    geom_stiffness: Float[Array, "ngeom"]
    geom_relaxation: Float[Array, "ngeom"]
    geom_restitution: Float[Array, "ngeom"]
    site_size: Float[Array, "nsite 3"]
    site_pos: Float[Array, "nsite 3"]
    site_quat: Float[Array, "nsite 4"]
    cam_pos: Float[Array, "ncam 3"]
    cam_quat: Float[Array, "ncam 4"]
    cam_pos0: Float[Array, "ncam 3"]
    cam_poscom0: Float[Array, "ncam 3"]
    cam_mat0: Float[Array, "ncam 9"]
    cam_fovy: Float[Array, "ncam"]
    cam_sensorsize: Float[Array, "ncam 2"]
    cam_intrinsic: Float[Array, "ncam 4"]
    pair_solref: Float[Array, "npair 2"]
    pair_solreffriction: Float[Array, "npair 2"]
    pair_solimp: Float[Array, "npair 5"]
    pair_margin: Float[Array, "npair"]
    pair_gap: Float[Array, "npair"]
    pair_adhesion: Float[Array, "npair"]
    pair_friction: Float[Array, "npair 5"]
    eq_solref: Float[Array, "neq 2"]
    eq_solimp: Float[Array, "neq 5"]
    eq_data: Float[Array, "neq 12"]
    tendon_solref_lim: Float[Array, "ntendon 2"]
    tendon_solimp_lim: Float[Array, "ntendon 5"]
    tendon_solref_fri: Float[Array, "ntendon 2"]
    tendon_solimp_fri: Float[Array, "ntendon 5"]
    tendon_range: Float[Array, "ntendon 2"]
    tendon_actfrcrange: Float[Array, "ntendon 2"]
    tendon_margin: Float[Array, "ntendon"]
    tendon_armature: Float[Array, "ntendon"]
    tendon_stiffness: Float[Array, "ntendon"]
    tendon_stiffnesspoly: Float[Array, "ntendon npoly"]
    tendon_damping: Float[Array, "ntendon"]
    tendon_dampingpoly: Float[Array, "ntendon npoly"]
    tendon_frictionloss: Float[Array, "ntendon"]
    tendon_lengthspring: Float[Array, "ntendon 2"]
    tendon_length0: Float[Array, "ntendon"]
    tendon_invweight0: Float[Array, "ntendon"]
    wrap_prm: Float[Array, "nwrap"]
    actuator_cranklength: Float[Array, "nactuator"]
    actuator_dynprm: Float[Array, "nactuator 10"]
    actuator_gainprm: Float[Array, "nactuator 10"]
    actuator_biasprm: Float[Array, "nactuator 10"]
    actuator_pid: Float[Array, "nactuator 5"]
    actuator_actrange: Float[Array, "nactuator 2"]
    actuator_damping: Float[Array, "nactuator"]
    actuator_dampingpoly: Float[Array, "nactuator npoly"]
    actuator_armature: Float[Array, "nactuator"]
    actuator_forcerange: Float[Array, "nactuator 2"]
    actuator_ctrlrange: Float[Array, "nu 2"]
    actuator_gear: Float[Array, "nout 6"]
    actuator_acc0: Float[Array, "nout"]
    actuator_length0: Float[Array, "nout"]
    actuator_lengthrange: Float[Array, "nout 2"]
    sensor_cutoff: Float[Array, "nsensor"]
    key_time: Float[Array, "nkey"]
    key_qpos: Float[Array, "nkey nq"]
    key_qvel: Float[Array, "nkey nv"]
    key_act: Float[Array, "nkey na"]
    key_mpos: Float[Array, "nkey 3*nmocap"]
    key_mquat: Float[Array, "nkey 4*nmocap"]
    key_ctrl: Float[Array, "nkey nu"]
    actuator_delay: Float[Array, "nactuator"] = None  # type: ignore[assignment]
    sensor_delay: Float[Array, "nsensor"] = None  # type: ignore[assignment]
    sensor_interval: Float[Array, "nsensor 2"] = None  # type: ignore[assignment]
    sdf: dict[str, Any] = struct.field(default_factory=dict)
    hessian: str = struct.field(pytree_node=False, default="auto")
    rotations: str = struct.field(pytree_node=False, default="lie")
    contact: str = struct.field(pytree_node=False, default="mujoco")
    backward: Backward = struct.field(pytree_node=False, default=EXACT)
    max_contacts: int | tuple[int, ...] | None = struct.field(pytree_node=False, default=None)
    max_geom_pairs: int | tuple[int, ...] | None = struct.field(pytree_node=False, default=None)
    present: Presence = struct.field(pytree_node=False, default=NOTHING)

    def __repr__(self) -> str:
        """Sizes, names and options, in about ten lines."""
        return summary(self)

    def nonzero_rows(self, leaf: str) -> tuple[int, ...]:
        """Rows of a leaf in `presence.OPTIONAL_FORCES` that may be nonzero."""
        return self.present[OPTIONAL_FORCES.index(leaf)]

    @property
    def flg_adhesion(self) -> bool:
        """Whether any geom or pair may have adhesion."""
        return bool(self.nonzero_rows("geom_adhesion") or self.nonzero_rows("pair_adhesion"))

    @property
    def names(self) -> Names:
        """Names of the model's elements."""
        return self.structure.names

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            # Called only for names that are no fields: they are static fields of the structure.
            # A model that is being copied or unpickled has no structure yet.
            if name.startswith("_") or "structure" not in self.__dict__:
                raise AttributeError(name)
            return getattr(self.__dict__["structure"], name)

    else:

        def __getattr__(self, name: str) -> Any: ...


def _replace(self: Model, **updates: Any) -> Model:
    """The model with new values of some fields, and with `present` updated for them."""
    present = updates.pop("present", self.present)
    return dataclasses.replace(self, **updates, present=extended(present, self, updates))


# Overrides the `replace` that Flax gives each record.
Model.replace = _replace
