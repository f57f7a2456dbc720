"""Factors and solves of dense matrices by LAPACK, which gets one matrix a call on a CPU.

They are for physics that users map by `jax.vmap`, see `primitives.lapack`.
"""

import functools

import jax.numpy as jnp
from jax import lax
from jax.scipy.linalg import cho_solve, solve_triangular
from jaxtyping import Array, Float, Int

from jaxsim.batching.primitives.one_at_a_time import one_at_a_time


def cholesky(A: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The lower Cholesky factor of A, of which the lower triangle is read; NaN if it has none."""
    return one_at_a_time(lambda A: [lax.linalg.cholesky(A, symmetrize_input=False)])(A)[0]


def cholesky_solve(L: Float[Array, "n n"], b: Float[Array, "n ..."]) -> Float[Array, "n ..."]:
    """`(L L^T)^-1 b`."""
    return one_at_a_time(lambda L, b: [cho_solve((L, True), b)])(L, b)[0]


def triangular_solve(
    T: Float[Array, "n n"], b: Float[Array, "n ..."], *, lower: bool
) -> Float[Array, "n ..."]:
    """`T^-1 b`; the other triangle of T is not read."""
    return one_at_a_time(lambda T, b: [solve_triangular(T, b, lower=lower)])(T, b)[0]


def eigh(A: Float[Array, "n n"]) -> tuple[Float[Array, "n"], Float[Array, "n n"]]:
    """Eigenvalues, in ascending order, and eigenvectors, as columns, of a symmetric matrix."""
    values, vectors = one_at_a_time(lambda A: list(jnp.linalg.eigh(A)))(A)
    return values, vectors


def solve(A: Float[Array, "n n"], b: Float[Array, "n"]) -> Float[Array, "n"]:
    """`A^-1 b` by LU factors, which its derivatives use again."""
    LU, _, order = one_at_a_time(lambda A: lax.linalg.lu(A))(lax.stop_gradient(A))

    def substitute(b, transposed: bool):
        f = functools.partial(_substitute, transposed=transposed)
        return one_at_a_time(f)(LU, order, b)[0]

    return lax.custom_linear_solve(
        lambda x: jnp.matmul(A, x, precision=lax.Precision.HIGHEST),
        b,
        lambda _, b: substitute(b, transposed=False),
        lambda _, b: substitute(b, transposed=True),
    )


def _substitute(
    LU: Float[Array, "n n"], order: Int[Array, "n"], b: Float[Array, "n"], transposed: bool
) -> list[Float[Array, "n"]]:
    """`A^-1 b` or `A^-T b`, where the rows of A in this order are `L U`."""
    triangle = functools.partial(
        lax.linalg.triangular_solve, LU, left_side=True, transpose_a=transposed
    )
    lower = functools.partial(triangle, lower=True, unit_diagonal=True)
    upper = functools.partial(triangle, lower=False)
    if transposed:
        x = lower(upper(b[:, None]))
        return [jnp.zeros_like(x).at[order].set(x)[:, 0]]
    return [upper(lower(b[order][:, None]))[:, 0]]
