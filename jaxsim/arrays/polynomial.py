"""Forces of MuJoCo's nonlinear springs and dampers.

The stiffness or damping coefficient is a polynomial, `k(x) = k0 + p0 x + p1 x^2 + ...`, and the
force is `-k(x) x`.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.norms import safe_norm


def poly_coefficient(
    linear: Float[Array, "..."], poly: Float[Array, "... npoly"], x: Float[Array, "..."]
) -> Float[Array, "..."]:
    """`k(x) = k0 + p0 x + p1 x^2 + ...` by Horner's rule."""
    total = jnp.zeros_like(x)
    for k in reversed(range(poly.shape[-1])):
        total = (total + poly[..., k]) * x
    return linear + total


def spring_force(
    stiffness: Float[Array, ""], poly: Float[Array, "npoly"], x: Float[Array, "n"]
) -> Float[Array, "n"]:
    """`-k(|x|) x` for a deflection of several components, `-k(x) x` for one component.

    The derivative at x = 0 is `-k(0)`, although the length of a vector has none there.
    """
    length = x[0] if len(x) == 1 else safe_norm(x)
    return -poly_coefficient(stiffness, poly, length) * x


def spring_energy(
    stiffness: Float[Array, ""], poly: Float[Array, "npoly"], x: Float[Array, "n"]
) -> Float[Array, ""]:
    """Potential energy of `spring_force`, `k0 x^2/2 + p0 x^3/3 + p1 x^4/4 + ...` (J)."""
    square = x @ x
    length = x[0] if len(x) == 1 else safe_norm(x)
    energy = 0.5 * stiffness * square
    for k, coefficient in enumerate(poly, start=3):
        # Even powers are formed without the square root, which has no derivative at zero.
        energy += coefficient / k * square ** (k // 2) * (length if k % 2 else 1)
    return energy


def damping_force(
    linear: Float[Array, "n"], poly: Float[Array, "n npoly"], v: Float[Array, "n"]
) -> Float[Array, "n"]:
    """`-k(|v|) v`, which opposes the velocity in both directions."""
    return -poly_coefficient(linear, poly, magnitude(v)) * v


def damping_slope(
    linear: Float[Array, "n"], poly: Float[Array, "n npoly"], v: Float[Array, "n"]
) -> Float[Array, "n"]:
    """Derivative of `k(|v|) v` with respect to the velocity, `k0 + 2 p0 |v| + 3 p1 v^2 + ...`."""
    orders = jnp.arange(2, 2 + poly.shape[-1], dtype=poly.dtype)
    return poly_coefficient(linear, poly * orders[None], magnitude(v))


def magnitude(v: Float[Array, "..."]) -> Float[Array, "..."]:
    """|v| with derivative zero at v = 0, where `jnp.abs` has derivative one."""
    return v * jnp.sign(v)
