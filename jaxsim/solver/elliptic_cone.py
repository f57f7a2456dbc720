"""Contacts with elliptic friction cones.

A contact has d rows: the normal, then d - 1 directions of friction (two of sliding, one of
spinning, two of rolling). With the scaled length of the friction residual

    T = |friction * r[1:]|

the cost of one contact has three zones (Todorov 2014; MuJoCo documentation, "Computation"):

    top      r0 >= T             0
    bottom   mu^2 r0 + T <= 0    1/2 sum(D r^2)
    middle   otherwise           1/2 D0 / (1 + mu^2) (r0 - T)^2

It is continuously differentiable if `D[j] = D[0] friction[j]^2 / mu^2`, which is MuJoCo's choice of
the regularisation of friction rows. MuJoCo writes the zones with `N = mu r0`. Dividing by mu, as
here, gives the same zones without a singularity at mu = 0.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.solver.contact_cost import ContactCost, OneContact


@struct.dataclass
class EllipticCone(ContactCost):
    """Cost of n contacts of the same dimension d in {3, 4, 6}.

    Attributes:
        aref: Reference acceleration; the residual is `r = J x - aref`. Normal first.
        D: Inverse regularisation `1 / R >= 0`. A contact with `D = 0` contributes nothing.
        mu: Friction of the regularised cone, `friction[0] / sqrt(impratio)` in MuJoCo, `>= 0`.
        friction: Friction coefficients of the rows 1 to d - 1, `>= 0`.
    """

    aref: Float[Array, "n d"]
    D: Float[Array, "n d"]
    mu: Float[Array, "n"]
    friction: Float[Array, "n d-1"]

    def slip(self, r: Float[Array, "n d"]) -> Float[Array, "n"]:
        """T, the scaled length of the friction residual of every contact."""
        return jax.vmap(lambda friction, r: tangent(friction, r)[0])(self.friction, r)

    def _one_contact(self):
        return _ONE_CONTACT, (self.D, self.mu, self.friction)


def tangent(friction: Float[Array, "m"], r: Float[Array, "d"]):
    """Length T, a divisor for it, and its gradient with respect to r[1:], zero where T is zero."""
    scaled = friction * r[1:]
    length, safe = norm_and_divisor(scaled)
    return length, safe, friction * scaled / safe


def zones(
    mu: Float[Array, ""], normal: Float[Array, ""], length: Float[Array, ""]
) -> tuple[Bool[Array, ""], Bool[Array, ""]]:
    """Whether the contact is in the bottom and in the middle zone."""
    top = normal >= length
    bottom = ~top & (mu * mu * normal + length <= 0)
    return bottom, ~top & ~bottom


def _select(at, bottom, middle):
    in_bottom, in_middle = at
    return jnp.where(in_bottom, bottom, jnp.where(in_middle, middle, 0.0))


def _cost(D, mu, friction, r):
    length, _, _ = tangent(friction, r)
    gap = r[0] - length
    middle = 0.5 * D[0] / (1 + mu * mu) * gap * gap
    return _select(zones(mu, r[0], length), 0.5 * jnp.sum(D * r * r), middle)


def _force(D, mu, friction, r):
    length, _, gradient = tangent(friction, r)
    pressure = D[0] / (1 + mu * mu) * (length - r[0])
    middle = pressure * jnp.concatenate([jnp.ones_like(r[:1]), -gradient])
    return _select(zones(mu, r[0], length), -D * r, middle)


def curvature_of(D, mu, friction, r, direction=None):
    """Curvature of one contact, for slips in this direction, by default the one they have."""
    length, safe, gradient = tangent(friction, r)
    normal = jnp.concatenate([jnp.ones_like(r[:1]), -gradient])
    along = jnp.outer(gradient, gradient)
    if direction is not None:
        both = jnp.outer(gradient, friction * direction)
        along = 0.5 * (both + both.T)
    length_curvature = (jnp.diag(friction * friction) - along) / safe
    middle = jnp.outer(normal, normal) + (length - r[0]) * jnp.pad(
        length_curvature, ((1, 0), (1, 0))
    )
    middle = D[0] / (1 + mu * mu) * middle
    return _select(zones(mu, r[0], length), jnp.diag(D), middle)


def _slopes(D, mu, friction, r, v):
    length, safe, gradient = tangent(friction, r)
    scaled = friction * v[1:]
    rate = gradient @ v[1:]
    # Cauchy-Schwarz makes this difference positive; rounding may not.
    length_curvature = jnp.maximum(jnp.sum(scaled * scaled) - rate * rate, 0.0) / safe
    stiffness, gap, speed = D[0] / (1 + mu * mu), r[0] - length, v[0] - rate
    at = zones(mu, r[0], length)
    first = _select(at, jnp.sum(D * r * v), stiffness * gap * speed)
    second = _select(at, jnp.sum(D * v * v), stiffness * (speed * speed - gap * length_curvature))
    return first, second


def _change(D, mu, friction, r, step):
    end = r + step
    before, after = tangent(friction, r)[0], tangent(friction, end)[0]
    (bottom0, middle0), (bottom1, middle1) = zones(mu, r[0], before), zones(mu, end[0], after)
    bottom = jnp.sum(D * step * (r + 0.5 * step))
    # Without cancellation: the difference of the squared lengths over the sum of the lengths.
    scaled = friction * step[1:]
    total = before + after
    squares = jnp.sum(scaled * (friction * (2 * r[1:] + step[1:])))
    stretch = squares / jnp.where(total > 0, total, 1.0)
    moved = step[0] - stretch
    middle = D[0] / (1 + mu * mu) * moved * (r[0] - before + 0.5 * moved)
    across = _cost(D, mu, friction, end) - _cost(D, mu, friction, r)
    same = jnp.where(middle0 & middle1, middle, across)
    return jnp.where(bottom0 & bottom1, bottom, same)


def _is_quadratic(D, mu, friction, r, end):
    """Whether it is in the top zone, or in the bottom zone, at both ends.

    These zones are convex, so it stays in them.
    """
    bottom0, middle0 = zones(mu, r[0], tangent(friction, r)[0])
    bottom1, middle1 = zones(mu, end[0], tangent(friction, end)[0])
    return (D[0] <= 0) | ((bottom0 == bottom1) & ~middle0 & ~middle1)


_ONE_CONTACT = OneContact(_cost, _force, curvature_of, _slopes, _change, _is_quadratic)
