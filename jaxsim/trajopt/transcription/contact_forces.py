"""Contact forces as controls, and Coulomb's law as complementarity.

For each contact, with the distance phi, the velocity v of its surfaces after the step, and friction
coefficients mu of its directions,

    0 <= phi             is complementary to  the normal force n
    0 <= n - sum(s)      is complementary to  gamma
    0 <= gamma +- mu v   is complementary to  s,  the two of each direction

The force is n along the normal and `mu (s+ - s-)` along the directions, so that friction is as
large as a pyramid allows and against what slides; gamma is then the sliding speed times mu (Stewart
and Trinkle 1996; Posa, Cantu, Tedrake 2014). Forces act where the step begins, distances are those
at its end.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Float

import jaxsim.engine as engine
from jaxsim.constraint.contact import contact_blocks
from jaxsim.constraint.jacobian import row_velocity
from jaxsim.dynamics.motion import motion_of
from jaxsim.engine.stepping import contacts
from jaxsim.model import Model, State
from jaxsim.trajopt.problem import Problem, ProblemError
from jaxsim.trajopt.space import StateSpace

_CONTACT_OFF = int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
# What shapes report that are too far from each other for a distance (m).
_FAR = 1e3


class _Forces(NamedTuple):
    """Unknowns of n contacts with d directions of friction, as controls (n (2 + 2 d),).

    Attributes:
      normal: n.
      gamma: gamma.
      friction: s+, then s-.
    """

    normal: Float[Array, "n"]
    gamma: Float[Array, "n"]
    friction: Float[Array, "n 2 d"]


def with_contact_forces(problem: Problem) -> Problem:
    """The problem of a model whose contacts exert what the optimiser chooses, for `Direct`.

    Controls are those of the model, then for each kind of contact n, gamma and s; costs see
    the model's alone, and `plan.ctrls[:, :model.nu]` are these. The law of contact is rigid,
    whatever the model's.

    Raises:
      ProblemError: the dynamics are no model, or there is no contact, or a `frame_skip`.
    """
    if not isinstance(problem.space, StateSpace) or problem.frame_skip != 1:
        raise ProblemError("with_contact_forces needs a jaxsim.Model and frame_skip=1")
    model, nu = problem.space.model, problem.low.size
    if model.flg_adhesion:
        raise ProblemError("with_contact_forces needs a model without adhesion")
    touching = jax.eval_shape(lambda x: contacts(motion_of(model, x)), problem.start)
    count = sum((r.stop - r.start) * 2 * r.condim for r in touching.ranges)
    if count == 0:
        raise ProblemError("with_contact_forces needs a model with contacts")
    flying = model.replace(
        opt=model.opt.replace(disableflags=model.opt.disableflags | _CONTACT_OFF)
    )

    def step(x: State, w: Float[Array, "nu+m"]) -> State:
        push = x.replace(qfrc_applied=x.qfrc_applied + _generalised(model, x, w[nu:]))
        return engine.step(flying, push, w[:nu]).replace(qfrc_applied=x.qfrc_applied)

    def pairs(x: State, w: Float[Array, "nu+m"], y: State):
        parts = [p for c in _contacts_at(model, x, w[nu:], y) for p in c.pairs()]
        a, b = zip(*parts, strict=True)
        return jnp.concatenate(a), jnp.concatenate(b)

    free = jnp.full(count, jnp.inf, problem.low.dtype)
    return problem.replace(
        step=step,
        running_cost=lambda x, w, t: problem.running_cost(x, w[:nu], t),
        low=jnp.concatenate([problem.low, -free]),
        high=jnp.concatenate([problem.high, free]),
        complementarity=pairs,
        normal_forces=lambda x, w: jnp.concatenate(
            [c.forces.normal for c in _contacts_at(model, x, w[nu:], x)]
        ),
    )


class _Kind(NamedTuple):
    """The contacts of one dimension.

    Attributes:
      forces: their unknowns.
      distance: phi after the step.
      velocity: v, normal first.
      coefficients: mu of each direction.
    """

    forces: _Forces
    distance: Float[Array, "n"]
    velocity: Float[Array, "n d+1"]
    coefficients: Float[Array, "n d"]

    def pairs(self):
        """Pairs that are complementary."""
        normal, gamma, s = self.forces
        drift = self.coefficients * self.velocity[:, 1:]
        against = gamma[:, None, None] + jnp.stack([drift, -drift], axis=1)
        return (
            (jnp.minimum(self.distance, _FAR), normal),
            (normal - s.sum((1, 2)), gamma),
            (against.ravel(), s.ravel()),
        )

    def rows(self) -> Float[Array, "n d+1"]:
        """Forces of the rows."""
        normal, _, s = self.forces
        friction = self.coefficients * (s[:, 0] - s[:, 1])
        return jnp.concatenate([normal[:, None], friction], axis=1)


def _contacts_at(model: Model, x: State, forces: Float[Array, "m"], y: State) -> list[_Kind]:
    """The contacts at x with their forces, and what they do until y."""
    touching = contacts(motion_of(model, x))
    velocities, distance = _velocities(model, x, y.qvel), contacts(motion_of(model, y)).dist
    kinds, at = [], 0
    for r, velocity in zip(_ranges(touching), velocities, strict=True):
        n, d = r.stop - r.start, r.condim - 1
        own = forces[at : at + n * (2 + 2 * d)].reshape(n, 2 + 2 * d)
        at += own.size
        unknowns = _Forces(own[:, 0], own[:, 1], own[:, 2:].reshape(n, 2, d))
        coefficients = touching.friction[r.slots, :d]
        kinds.append(_Kind(unknowns, distance[r.slots], velocity, coefficients))
    return kinds


def _velocities(model: Model, x: State, qvel: Float[Array, "nv"]) -> list[Array]:
    """Velocities (n, condim) of the surfaces at x, for each kind of contact."""
    motion = motion_of(model, x.replace(qvel=qvel))
    blocks = contact_blocks(motion, contacts(motion))
    return [row_velocity(motion, block.jacobian) for block in blocks]


def _generalised(model: Model, x: State, forces: Float[Array, "m"]) -> Float[Array, "nv"]:
    """`J^T f`."""
    rows = [kind.rows() for kind in _contacts_at(model, x, forces, x)]
    return jax.vjp(lambda qvel: _velocities(model, x, qvel), x.qvel)[1](rows)[0]


def _ranges(touching):
    return [r for r in touching.ranges if r.stop > r.start]
