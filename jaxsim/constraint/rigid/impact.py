"""The time of impact within a step, and Newton's law of restitution.

A row of a rigid contact moves as `phi + v t + a t^2 / 2`, with a its acceleration without contact
forces. If that is negative at the end of the step, the surfaces meet at its root t, at the speed
`v_i = v + a t`, and part at `v_p = -e min(v_i, 0)`. The rest of the step, `s = h - t`, is

    a flight     to the velocity v^ = v_p + s a, or
    a contact    with v^ = 0, if the flight would end within the step: s v_p + s^2 a / 2 < 0.

So sequences of ever smaller bounces end by themselves, and there is no threshold. Surfaces that do
not meet have `v^ = -2 phi / h - v`, which other impacts must not violate.

Impulses displace by the time that is left when they act. Relative to the path at the mean velocity,
where that is h / 2,

    s (1 + lambda) / 2 - h / 2,    lambda = 1 for a flight, v_i / (v_i + s a) for a contact

seconds of the impulse's velocity are added, since a share lambda of the impulse acts at once and
the others during the rest. With one contact this is the exact motion under constant forces. What
other contacts add to an impulse is taken to act during the whole step.
"""

from typing import Any

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float


@struct.dataclass
class Approach:
    """The normal motion of n contacts at the beginning of a step.

    Attributes:
      dist: phi, negative for penetration (m).
      velocity: v, negative while approaching (m/s).
      restitution: e, from 0 to 1.
      inverse_weight: sum of both bodies' mean inverse inertia (1/kg).
    """

    dist: Float[Array, "n"]
    velocity: Float[Array, "n"]
    restitution: Float[Array, "n"]
    inverse_weight: Float[Array, "n"]


@struct.dataclass
class Impact:
    """What n contacts do within a step.

    Attributes:
      target: v^, the least normal velocity after the step (m/s).
      lever: time for which the impulse displaces, less half a step (s).
      change: change of the normal velocity by the contact alone, at least zero (m/s).
    """

    target: Float[Array, "n"]
    lever: Float[Array, "n"]
    change: Float[Array, "n"]


def impact(h: Float[Array, ""], at: Approach, acceleration: Float[Array, "n"]) -> Impact:
    """The impacts within a step of length h, for normal accelerations without contact forces."""
    phi, v, a = at.dist, at.velocity, acceleration
    meets = (phi <= 0) | (phi + h * v + 0.5 * h * h * a < 0)
    t = jnp.where(meets, _first_root(phi, v, a), 0.0)
    rest = h - t
    before = v + t * a
    # At rest, the derivative is that of pressing: one impulse, at once.
    before = jnp.where(before <= 0, before, 0.0)
    parting = -at.restitution * before
    stays = rest * parting + 0.5 * rest * rest * a < 0
    fall = jnp.where(stays, rest * a, 0.0)
    total = before + fall
    at_once = jnp.where(stays, before / jnp.where(total < 0, total, 1.0), 1.0)
    after = jnp.where(stays, 0.0, parting + rest * a)
    target = jnp.where(meets, after, -2 * phi / h - v)
    lever = jnp.where(meets, 0.5 * (rest * (1 + at_once) - h), 0.0)
    change = jnp.where(stays, -total, parting - before)
    return Impact(target, lever, jnp.where(meets, change, 0.0))


def _first_root(phi, v, a) -> Float[Array, "n"]:
    """The first t >= 0 with `phi + v t + a t^2 / 2 = 0`; 0 where phi is not positive."""
    square = v * v - 2 * a * phi
    open_ = (phi > 0) & (square > 0)
    speed = jnp.sqrt(jnp.where(open_, square, 1.0)) - v
    return jnp.where(open_ & (speed > 0), 2 * phi / jnp.where(speed > 0, speed, 1.0), 0.0)


def at_targets(h: Float[Array, ""], kind: Any, at: Approach, found: Impact) -> Any:
    """The cost of contacts with the reference accelerations that lead to the targets."""
    normal = (found.target - at.velocity) / h
    on = kind.D[:, 0] > 0
    return kind.replace(aref=kind.aref.at[:, 0].set(jnp.where(on, normal, 0.0)))
