"""Preconditioned conjugate gradients, for Hessians that are not formed as matrices.

Only products with the Hessian `M + J^T W J` and solves with a cheaper approximation of it are used
(Saad 2003, "Iterative Methods for Sparse Linear Systems", algorithm 9.1).
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.solver.operator import Lifted, LinearStatus, Operator, Rows

LinearMap = Callable[[Array], Array]


class _State(NamedTuple):
    x: Array
    residual: Array
    direction: Array
    energy: Array
    count: Array


def pcg(
    product: LinearMap,
    precondition: LinearMap,
    b: Float[Array, "nv"],
    tolerance: float | Float[Array, ""],
    iterations: int,
    least: float | Float[Array, ""] = 0.0,
) -> tuple[Float[Array, "nv"], LinearStatus]:
    """Solve `A x = b` for a symmetric positive definite A.

    Args:
        product: `x -> A x`.
        precondition: `r -> P^-1 r` with P symmetric positive definite and close to A.
        b: Right-hand side.
        tolerance: Bound on the residual `b - A x` relative to b, in the norm of `P^-1`.
        iterations: Largest number of products.
        least: A square of that norm at which to end, however large b is.

    Returns:
        The solution, which is linear in b up to the tolerance, and the status.
    """
    z = precondition(b)
    start = _State(jnp.zeros_like(b), b, z, b @ z, jnp.zeros((), jnp.int32))
    floor = jnp.maximum(jnp.asarray(tolerance, b.dtype) ** 2 * start.energy, least)

    def unfinished(state: _State) -> Array:
        return (state.count < iterations) & (state.energy > floor)

    end = lax.while_loop(unfinished, lambda s: _advance(product, precondition, s), start)
    return end.x, LinearStatus(end.count, end.energy <= floor)


def _advance(product: LinearMap, precondition: LinearMap, state: _State) -> _State:
    """One iteration; if the product is indefinite or not finite, the point does not change.

    The energy is then NaN, which ends the loop without convergence.
    """
    ap = product(state.direction)
    power = state.direction @ ap
    sound = (power > 0) & jnp.isfinite(power)
    alpha = jnp.where(sound, state.energy / jnp.where(sound, power, 1.0), 0.0)
    residual = state.residual - alpha * jnp.where(sound, ap, 0.0)
    z = precondition(residual)
    energy = jnp.where(sound, residual @ z, jnp.nan)
    direction = z + energy / state.energy * state.direction
    return _State(state.x + alpha * state.direction, residual, direction, energy, state.count + 1)


def hessian_product(
    operator: Operator, curvatures: Rows, x: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """`(M + J^T W J) x`, from the operator's products with M and J."""
    y = operator.lift(x)
    return -operator.residual(y, tuple(map(_weigh, curvatures, operator.rows(y))))


def _weigh(W: Array, jx: Array) -> Array:
    """`-W J x` of one block."""
    if W.ndim == jx.ndim:
        return -W * jx
    return -jax.vmap(jnp.matmul)(W, jx)


def pcg_solve(
    operator: Operator,
    curvatures: Rows,
    r: Float[Array, "nv"],
    precondition: LinearMap,
    tolerance: float | Float[Array, ""],
    iterations: int,
    least: float | Float[Array, ""] = 0.0,
) -> tuple[Lifted, LinearStatus]:
    """The lifted `(M + J^T W J)^-1 r` without forming a matrix, for use in `Operator.solve`.

    Args:
        operator: The operator, of which only products are used, not `solve`.
        curvatures: W of each block.
        r: Right-hand side.
        precondition: See `pcg`.
        tolerance: See `pcg`.
        iterations: See `pcg`.
        least: See `pcg`.
    """

    def product(x: Array) -> Array:
        return hessian_product(operator, curvatures, x)

    x, status = pcg(product, precondition, r, tolerance, iterations, least)
    return operator.lift(x), status
