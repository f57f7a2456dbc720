"""`Maximal`: steps of free bodies whose joints are constraint rows.

    minimise  1/2 |a - a_s|_M^2 + s(J a - aref)    over the accelerations a of all bodies

with M block-diagonal. The joints' rows `P (X a + b) = -2/T P e' - 1/T^2 P e` (see `coordinates`)
are rigid: passes take their regularisation away, so the error of a joint is what a time step leaves
and decays within a few (T is twice the step). Rows of the tree, limits for instance, are the same
functions of `q'' = -S^+ (X a + b)`; its forces act through `-S^+ X`. Armature, and the implicit
damping of a step, are rows with the curvature of an inertia.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.precision import full_precision
from jaxsim.arrays.whole import as_a_whole
from jaxsim.constraint import constrained_acceleration
from jaxsim.dynamics.motion import Motion, motion_of
from jaxsim.dynamics.rnea import bias_forces, generalized_force
from jaxsim.engine.instant import Instant
from jaxsim.engine.integrators import INTEGRATORS
from jaxsim.engine.integrators.advance import next_activations
from jaxsim.engine.integrators.euler import damps_implicitly
from jaxsim.engine.status import Status
from jaxsim.engine.stepping import applied_wrench, contacts, forces
from jaxsim.forces.damper import dof_damping_slope
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.maximal.coordinates import (
    JointMotion,
    Links,
    body_poses,
    joint_motion,
    take_poses,
)
from jaxsim.maximal.rows import joint_rows, reflected_rows, tree_rows
from jaxsim.model import Model, State
from jaxsim.model.inputs import admit
from jaxsim.spatial import Pose, quat_conj, quat_mul


@struct.dataclass
class MaximalState:
    """The state of a model in maximal coordinates.

    Attributes:
      bodies: state of the free bodies, in the order of their ids.
      qpos: joint coordinates, as of the last velocity; the exact ones are near. Hinges may have
        turned several times.
      act: activations of the actuators.
    """

    bodies: State
    qpos: Float[Array, "nq"]
    act: Float[Array, "na"]


class _Instant(NamedTuple):
    """Forces and accelerations of free bodies, and their joints."""

    now: Instant
    joints: JointMotion


@struct.dataclass
class Maximal:
    """A model in maximal coordinates; make one with `jaxsim.to_maximal`.

    Attributes:
      bodies: the model of the free bodies.
      tree: the model that has the joints.
    """

    bodies: Model
    tree: Model

    def state(self, state: State) -> MaximalState:
        """The state of the free bodies in a state of the tree.

        Args:
          state: a state of `tree`.
        """
        _, state, _ = admit(self.tree, state)
        place = lambda t: self._moving(  # noqa: E731
            body_poses(self.tree, integrate_pos(self.tree, state.qpos, state.qvel, t), state)
        )
        zero, one = jnp.zeros((), state.qpos.dtype), jnp.ones((), state.qpos.dtype)
        pose, rate = jax.jvp(place, (zero,), (one,))
        spin = jax.vmap(lambda q, dq: 2 * quat_mul(quat_conj(q), dq)[1:])(pose.quat, rate.quat)
        velocity = jnp.concatenate([rate.pos, spin], axis=1).reshape(-1)
        bodies = State(
            qpos=jnp.concatenate([pose.pos, pose.quat], axis=1).reshape(-1),
            qvel=velocity,
            act=jnp.zeros(0, state.qpos.dtype),
            time=state.time,
            qacc_warmstart=jnp.zeros_like(velocity),
            xfrc_applied=state.xfrc_applied,
            qfrc_applied=jnp.zeros_like(velocity),
            mocap_pos=state.mocap_pos,
            mocap_quat=state.mocap_quat,
            time_excess=state.time_excess,
        )
        return MaximalState(bodies, state.qpos, state.act)

    def tree_state(self, state: MaximalState) -> State:
        """The state of the tree that is closest to one of the free bodies."""
        return _tree_state(state, self._joints(motion_of(self.bodies, state.bodies), state))

    def joint_error(self, state: MaximalState) -> Float[Array, ""]:
        """The largest error of a joint (m or rad)."""
        joints = self._joints(motion_of(self.bodies, state.bodies), state)
        return jnp.max(jnp.abs(joints.error), initial=0)

    def acceleration(
        self, state: MaximalState, ctrl: Float[Array, "nu"] | None = None
    ) -> tuple[Float[Array, "nv"], Status]:
        """Accelerations of the joint coordinates, and the status of the solve."""
        return _acceleration(self, state, ctrl)

    def step(self, state: MaximalState, ctrl: Float[Array, "nu"] | None = None) -> MaximalState:
        """Advance by one time step.

        Args:
          state: the state.
          ctrl: controls of the tree's actuators; None means zeros.
        """
        return _step(self, state, ctrl)[0]

    def step_with_status(
        self, state: MaximalState, ctrl: Float[Array, "nu"] | None = None
    ) -> tuple[MaximalState, Status]:
        """`step`, and the status of its solve."""
        return _step(self, state, ctrl)

    def _moving(self, poses: Pose) -> Pose:
        return take_poses(poses, Links.of(self.tree).body)

    def _joints(self, motion: Motion, state: MaximalState) -> JointMotion:
        poses = Pose(quat=motion.kin.xquat, pos=motion.kin.xpos)
        velocity = motion.qvel.reshape(-1, 6)
        return joint_motion(self.tree, poses, velocity, state.qpos, state.bodies)


def _tree_state(state: MaximalState, joints: JointMotion) -> State:
    """The state of the tree with these coordinates and velocities."""
    bodies, nothing = state.bodies, jnp.zeros_like(joints.qvel)
    return bodies.replace(
        qpos=joints.qpos,
        qvel=joints.qvel,
        act=state.act,
        qacc_warmstart=nothing,
        qfrc_applied=nothing,
    )


@as_a_whole
@full_precision
def _acceleration(maximal: Maximal, state: MaximalState, ctrl):
    found = _evaluate(maximal, state, ctrl, state.bodies, None, damped=False)
    joints = found.joints
    return joints.rates @ found.now.qacc + joints.rates_bias, Status.of(found.now.constrained)


@as_a_whole
@full_precision
def _step(maximal: Maximal, state: MaximalState, ctrl) -> tuple[MaximalState, Status]:
    start, found = state, []

    def evaluated(state: State, ahead=None) -> Instant:
        found.append(_evaluate(maximal, start, ctrl, state, ahead, damped=True))
        return found[-1].now

    step = INTEGRATORS[maximal.bodies.opt.integrator](maximal.bodies, state.bodies, evaluated)
    (last,) = found
    after = step.after.replace(qacc_warmstart=lax.stop_gradient(step.qacc))
    acting = last.now.actuation
    tree, joints = maximal.tree, last.joints
    act = next_activations(tree, state.act, acting.act_dot, acting.paths)
    qpos = integrate_pos(tree, joints.qpos, joints.qvel, tree.opt.timestep)
    return MaximalState(after.replace(act=state.bodies.act), qpos, act), step.status


def _evaluate(
    maximal: Maximal, state: MaximalState, ctrl, bodies: State, ahead, damped: bool
) -> _Instant:
    """Forces, contacts and accelerations of free bodies; `damped` for those of a time step."""
    free, tree = maximal.bodies, maximal.tree
    motion = motion_of(free, bodies, ahead)
    joints = maximal._joints(motion, state)
    touching = contacts(motion)
    inner = _tree_state(state, joints)
    tree_motion = motion_of(tree, inner)
    passive, actuators = forces(tree_motion, inner, ctrl, touching)
    bias, own_bias = bias_forces(free, motion.kin, motion.vel)
    on_links = generalized_force(free, motion.kin, applied_wrench(motion, bodies) - bias) - own_bias
    on_joints = passive.qfrc_passive + actuators.qfrc_actuator
    total = on_links + bodies.qfrc_applied + on_joints @ joints.rates
    implicit = damped and damps_implicitly(tree)
    slope = tree.opt.timestep * dof_damping_slope(tree, joints.qvel) if implicit else 0.0
    rows = [
        *joint_rows(free, tree, joints),
        reflected_rows(free, tree, joints, slope),
        *tree_rows(free, tree_motion, joints),
    ]
    found = constrained_acceleration(motion, touching, total, bodies.qacc_warmstart, rows)
    return _Instant(Instant(motion, passive, actuators, total, found), joints)
