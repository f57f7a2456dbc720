"""A small quadratic program with bounds, by projected Newton steps (Tassa et al. 2014).

Minimise `1/2 u' H u + g' u` over `low <= u <= high`.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.batching.matrices import cholesky, cholesky_solve

_STEPS = 50
# Lengths along the projected step; the best of them and of one that surely descends is taken.
_LENGTHS = 0.5 ** np.arange(6)


class BoxSolution(NamedTuple):
    """The minimiser, and which of its numbers are not held by a bound."""

    u: Float[Array, "m"]
    free: Bool[Array, "m"]


def box_qp(
    hessian: Float[Array, "m m"],
    gradient: Float[Array, "m"],
    low: Float[Array, "m"],
    high: Float[Array, "m"],
) -> BoxSolution:
    """The minimiser of a strictly convex quadratic function within bounds.

    A Newton step for the numbers that no bound holds, projected onto the bounds, until none of them
    has a slope. The set of held numbers settles after a few steps, and the last one is exact.

    Args:
      hessian: H, positive definite.
      gradient: g.
      low: lower bounds; may be infinite, and must not exceed `high`.
      high: upper bounds.
    """
    small = 10 * jnp.finfo(gradient.dtype).eps * (1 + jnp.abs(gradient).max())

    def objective(u):
        return 0.5 * u @ hessian @ u + gradient @ u

    def slope_and_free(u):
        slope = hessian @ u + gradient
        return slope, ~(((u <= low) & (slope > 0)) | ((u >= high) & (slope < 0)))

    def unfinished(carry):
        step, _, slope, free, moved = carry
        return (step < _STEPS) & moved & (jnp.abs(jnp.where(free, slope, 0)).max() > small)

    def body(carry):
        step, u, slope, free, _ = carry
        direction = -restricted_solve(hessian, free, slope[:, None])[:, 0]
        bound = jnp.where(direction > 0, high, low)
        safe = _descent_length(hessian, slope, direction, bound - u)
        lengths = jnp.append(_LENGTHS.astype(u.dtype), safe)
        points = jax.vmap(lambda length: _projected(u, length * direction, bound))(lengths)
        values = jax.vmap(objective)(points)
        best = jnp.argmin(values)
        moved = values[best] < objective(u)
        u = jnp.where(moved, points[best], u)
        return step + 1, u, *slope_and_free(u), moved

    start = jnp.clip(jnp.zeros_like(gradient), low, high)
    carry = (0, start, *slope_and_free(start), jnp.asarray(True))
    _, u, _, free, _ = lax.while_loop(unfinished, body, carry)
    return BoxSolution(u, free)


def _projected(u, change, bound) -> Float[Array, "m"]:
    """`u + change`, or the bound where that is beyond it, or short of it by rounding only."""
    almost = 1 - 8 * jnp.finfo(u.dtype).eps
    return jnp.where(jnp.abs(change) >= almost * jnp.abs(bound - u), bound, u + change)


def _descent_length(hessian, slope, direction, room) -> Float[Array, ""]:
    """The minimiser along the projected step, no farther than where that bends first.

    Up to there it is straight, and descends: what the bounds cut off at once went uphill.
    """
    straight = jnp.where(room == 0, 0, direction)
    bends = jnp.where(straight == 0, jnp.inf, room / jnp.where(straight == 0, 1, straight))
    curvature = straight @ hessian @ straight
    return jnp.minimum(-(slope @ straight) / jnp.where(curvature > 0, curvature, 1), bends.min())


def restricted_solve(
    hessian: Float[Array, "m m"], free: Bool[Array, "m"], right: Float[Array, "m k"]
) -> Float[Array, "m k"]:
    """`H_ff^-1 right_f` for the free numbers, zero for the others."""
    both = free[:, None] & free[None, :]
    matrix = jnp.where(both, hessian, jnp.eye(len(free), dtype=hessian.dtype))
    return cholesky_solve(cholesky(matrix), jnp.where(free[:, None], right, 0))
