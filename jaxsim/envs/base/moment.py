"""`Moment`: the quantities that a task can use, with MuJoCo's names."""

from functools import cached_property
from typing import Any

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.constraint import Constrained, constrained_at
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.motion import Motion, motion_of
from jaxsim.engine.readout import body_wrenches
from jaxsim.engine.stepping import contacts, evaluate, forces
from jaxsim.model import Model, State
from jaxsim.quantities import body_forces


@struct.dataclass
class Moment:
    """The contents of MuJoCo's `mjData` after `mj_step`, or after `mj_forward` at a reset.

    Positions and velocities are those after the step. Derived quantities (`xpos`, `cvel`, ...) are
    those of the last evaluation of forces: for the state before the last time step, or in its
    fourth stage with Runge-Kutta. Gymnasium's tasks read these, so ours do, too. Derived quantities
    are computed only if they are used.

    Attributes:
      model: the model.
      state: the state after the step.
      last: the state at which forces were evaluated last.
      ctrl: the controls of the step.
      action: the action of the agent; zero at a reset.
      before: `EnvState.info` before the step; at a reset, the result of the task's `draw`.
      qacc_last: acceleration in the last evaluation; None at a reset.
    """

    model: Model
    state: State
    last: State
    ctrl: Float[Array, "nu"]
    action: Float[Array, "..."]
    before: dict[str, Any]
    qacc_last: Float[Array, "nv"] | None = None

    @property
    def qpos(self) -> Float[Array, "nq"]:
        """Positions now."""
        return self.state.qpos

    @property
    def qvel(self) -> Float[Array, "nv"]:
        """Velocities now."""
        return self.state.qvel

    @cached_property
    def motion(self) -> Motion:
        """Kinematics and velocities in the last evaluation of forces."""
        return motion_of(self.model, self.last)

    @property
    def kin(self) -> Kinematics:
        """Kinematics of the last evaluation."""
        return self.motion.kin

    @cached_property
    def _constrained(self) -> Constrained:
        """Contacts and constraint forces of the last evaluation; needs a solve only at a reset."""
        if self.qacc_last is None:
            return evaluate(self.model, self.last, self.ctrl).constrained
        return constrained_at(self.motion, contacts(self.motion), self.qacc_last)

    @property
    def xpos(self) -> Float[Array, "nbody 3"]:
        """Positions of the bodies."""
        return self.kin.xpos

    @property
    def xquat(self) -> Float[Array, "nbody 4"]:
        """Orientations of the bodies."""
        return self.kin.xquat

    @property
    def xmat(self) -> Float[Array, "nbody 3 3"]:
        """Orientations of the bodies as matrices."""
        return self.kin.xmat

    @property
    def xipos(self) -> Float[Array, "nbody 3"]:
        """Centres of mass of the bodies."""
        return self.kin.xipos

    @property
    def geom_xpos(self) -> Float[Array, "ngeom 3"]:
        """Positions of the geoms."""
        return self.kin.geom_xpos

    @property
    def site_xpos(self) -> Float[Array, "nsite 3"]:
        """Positions of the sites."""
        return self.kin.site_xpos

    @property
    def subtree_com(self) -> Float[Array, "nbody 3"]:
        """Centres of mass of the bodies' subtrees."""
        return self.kin.subtree_com

    @property
    def cinert(self) -> Float[Array, "nbody 10"]:
        """Inertias of the bodies about the centre of mass of their tree."""
        return body_forces.cinert(self.model, self.kin)

    @property
    def cvel(self) -> Float[Array, "nbody 6"]:
        """Twists of the bodies about the centre of mass of their tree."""
        return body_forces.cvel(self.model, self.kin, self.motion.vel)

    @property
    def qfrc_actuator(self) -> Float[Array, "nv"]:
        """Generalised forces of the actuators."""
        return forces(self.motion, self.last, self.ctrl, contacts(self.motion))[1].qfrc_actuator

    @property
    def qfrc_constraint(self) -> Float[Array, "nv"]:
        """Generalised forces of all constraints."""
        return self._constrained.qfrc_constraint

    @property
    def qacc(self) -> Float[Array, "nv"]:
        """Acceleration."""
        return self._constrained.qacc

    @property
    def cfrc_ext(self) -> Float[Array, "nbody 6"]:
        """External wrenches on the bodies as of `mj_rnePostConstraint`; zero at a reset."""
        if self.qacc_last is None:
            return jnp.zeros((self.model.nbody, 6), self.qpos.dtype)
        wrench = body_wrenches(self.motion, self.last, self._constrained)
        return body_forces.cfrc_ext(self.model, self.kin, wrench)
