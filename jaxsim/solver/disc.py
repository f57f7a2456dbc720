"""Contacts whose friction force has a known bound, an ellipse.

A contact has d rows as in `EllipticCone`: the normal, then d - 1 directions of friction. The normal
row may only push, with cost `1/2 D0 min(r0, 0)^2`. Friction does not depend on it. With the scaled
length `T = |friction * r[1:]|`, a known normal force n, and `D[j] = k friction[j]^2`, its cost is

    1/2 k T^2            where k T < n: the contact sticks
    n (T - n / (2 k))    beyond: it slides

so that the force is the point of the ellipse `|f / friction| <= n` closest to `-k friction^2 r`.
For `D -> infinity` this is `n T`, dry friction without creep.
"""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.solver.contact_cost import ContactCost, OneContact
from jaxsim.solver.unilateral import change_of_square


@struct.dataclass
class Disc(ContactCost):
    """Cost of n contacts of the same dimension d in {3, 4, 6}.

    Attributes:
        aref: Reference acceleration; the residual is `r = J x - aref`. Normal first.
        D: Inverse regularisation `1 / R >= 0`. Rows with `D = 0` contribute nothing.
        friction: Friction coefficients of the rows 1 to d - 1, `> 0`.
        normal: Normal force that limits friction, `>= 0`.
    """

    aref: Float[Array, "n d"]
    D: Float[Array, "n d"]
    friction: Float[Array, "n d-1"]
    normal: Float[Array, "n"]

    def _one_contact(self):
        return _ONE_CONTACT, (self.D, self.friction, self.normal)


def _stiffness(D, friction):
    """k; zero where the contact contributes nothing."""
    square = friction[0] * friction[0]
    return D[1] / jnp.where(square > 0, square, 1.0)


def _clipped(k, normal, length):
    """The scaled length clipped to where the contact slides, and whether it sticks."""
    sticks = (k * length < normal) | (k <= 0)
    return jnp.where(sticks, length, normal / jnp.where(k > 0, k, 1.0)), sticks


def _pressure(D, friction, normal, r):
    """`-f / (friction^2 r)` of the friction rows, whether it sticks, and a divisor for T."""
    length, safe = norm_and_divisor(friction * r[1:])
    k = _stiffness(D, friction)
    sticks = _clipped(k, normal, length)[1]
    return jnp.where(sticks, k, normal / safe), sticks, safe


def _cost(D, friction, normal, r):
    length, _ = norm_and_divisor(friction * r[1:])
    k = _stiffness(D, friction)
    c, _ = _clipped(k, normal, length)
    push = jnp.minimum(r[0], 0)
    return 0.5 * D[0] * push * push + k * c * (length - 0.5 * c)


def _force(D, friction, normal, r):
    pressure, _, _ = _pressure(D, friction, normal, r)
    push = -D[0] * jnp.minimum(r[:1], 0)
    return jnp.concatenate([push, -pressure * friction * friction * r[1:]])


def _curvature(D, friction, normal, r):
    pressure, sticks, safe = _pressure(D, friction, normal, r)
    gradient = friction * friction * r[1:] / safe
    along = jnp.where(sticks, 0.0, pressure) * jnp.outer(gradient, gradient)
    W = jnp.pad(pressure * jnp.diag(friction * friction) - along, ((1, 0), (1, 0)))
    return W.at[0, 0].set(jnp.where(r[0] < 0, D[0], 0.0))


def _slopes(D, friction, normal, r, v):
    pressure, sticks, safe = _pressure(D, friction, normal, r)
    scaled = friction * v[1:]
    rate = jnp.sum(friction * r[1:] * scaled)
    # Cauchy-Schwarz makes this difference positive; rounding may not.
    square = jnp.sum(scaled * scaled)
    length_curvature = jnp.maximum(square - jnp.where(sticks, 0.0, rate / safe) ** 2, 0.0)
    push = jnp.where(r[0] < 0, D[0] * v[0], 0.0)
    return push * r[0] + pressure * rate, push * v[0] + pressure * length_curvature


def _change(D, friction, normal, r, step):
    start, scaled = friction * r[1:], friction * step[1:]
    before, after = norm_and_divisor(start)[0], norm_and_divisor(start + scaled)[0]
    # Without cancellation: the difference of the squared lengths over the sum of the lengths.
    total = before + after
    stretch = jnp.sum(scaled * (2 * start + scaled)) / jnp.where(total > 0, total, 1.0)
    k = _stiffness(D, friction)
    (c0, stick0), (c1, stick1) = (_clipped(k, normal, length) for length in (before, after))
    grown = jnp.where(stick0 & stick1, stretch, jnp.where(stick0 | stick1, c1 - c0, 0.0))
    # The cost is `k c (T - c / 2)`, see `huber.Huber.change`.
    slide = 0.5 * k * ((c0 + c1) * stretch + grown * ((before - c0) + (after - c1)))
    return slide + 0.5 * D[0] * change_of_square(r[0], step[0])


def _is_quadratic(D, friction, normal, r, end):
    """Whether it sticks at both ends, with a normal force at both or at neither."""
    k = _stiffness(D, friction)
    lengths = (norm_and_divisor(friction * x[1:])[0] for x in (r, end))
    sticks = [_clipped(k, normal, length)[1] for length in lengths]
    slips = (k > 0) & (normal > 0) & ~(sticks[0] & sticks[1])
    return ~slips & ((D[0] <= 0) | ((r[0] < 0) == (end[0] < 0)))


_ONE_CONTACT = OneContact(_cost, _force, _curvature, _slopes, _change, _is_quadratic)
