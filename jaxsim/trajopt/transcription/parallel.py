"""Block-pentadiagonal systems by an associative scan, for devices with many cores.

Two steps at a time make the system block-tridiagonal. A range of such blocks is a quadratic
function of the unknowns at its two ends, once what is between is eliminated; two ranges that meet
are one range, in which their common unknown is eliminated. So all ranges from the first block, and
all up to the last, are found by two associative scans, and meet at each unknown (Sarkka,
Garcia-Fernandez 2023, "Temporal parallelization of dynamic programming and linear quadratic
control").
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Float

from jaxsim.batching.matrices import cholesky, cholesky_solve


class _Range(NamedTuple):
    """`1/2 x' P x + p' x` in what is left of, and what is at the right end of, a range of blocks.

    Attributes:
      left: P of the left unknown.
      cross: P of the right unknown by the left one.
      right: P of the right unknown.
      left_slope: p of the left unknown.
      right_slope: p of the right unknown.
    """

    left: Float[Array, "k k"]
    cross: Float[Array, "k k"]
    right: Float[Array, "k k"]
    left_slope: Float[Array, "k"]
    right_slope: Float[Array, "k"]


def solve_in_parallel(
    diagonal: Float[Array, "T m m"],
    first: Float[Array, "T m m"],
    second: Float[Array, "T m m"],
    b: Float[Array, "T m"],
) -> Float[Array, "T m"]:
    """`H^-1 b`, with the blocks of a `Pentadiagonal`."""
    T, m = b.shape
    blocks = _in_pairs(diagonal, first, second, b)
    join = jax.vmap(_joined)
    before = lax.associative_scan(join, blocks)
    # Beyond the last block there is another one, without any coupling.
    beyond = jax.tree.map(lambda x: jnp.zeros_like(x[:1]), blocks)
    beyond = beyond._replace(right=jnp.eye(2 * m, dtype=b.dtype)[None])
    later = jax.tree.map(lambda x, end: jnp.concatenate([x[1:], end]), blocks, beyond)
    after = lax.associative_scan(lambda a, b: join(b, a), later, reverse=True)
    slope = before.right_slope + after.left_slope
    x = -jax.vmap(_solve)(before.right + after.left, slope)
    return x.reshape(-1, m)[:T]


def _solve(A: Float[Array, "k k"], b: Float[Array, "k ..."]) -> Float[Array, "k ..."]:
    """`A^-1 b` for a symmetric positive definite matrix."""
    return cholesky_solve(cholesky(A), b)


def _joined(a: _Range, b: _Range) -> _Range:
    """Two ranges that meet, as one."""
    found = _solve(
        a.right + b.left,
        jnp.concatenate([a.cross, b.cross.T, (a.right_slope + b.left_slope)[:, None]], axis=1),
    )
    k = len(a.right_slope)
    by_left, by_right, alone = found[:, :k], found[:, k : 2 * k], found[:, -1]
    return _Range(
        left=a.left - a.cross.T @ by_left,
        cross=-b.cross @ by_left,
        right=b.right - b.cross @ by_right,
        left_slope=a.left_slope - a.cross.T @ alone,
        right_slope=b.right_slope - b.cross @ alone,
    )


def _in_pairs(diagonal: Array, first: Array, second: Array, b: Array) -> _Range:
    """Each pair of steps as a range of one block."""
    odd, m = len(b) % 2, b.shape[1]
    diagonal = jnp.concatenate([diagonal, jnp.eye(m, dtype=b.dtype)[None]]) if odd else diagonal
    pad = lambda x: jnp.pad(x, ((0, odd), *((0, 0),) * (x.ndim - 1)))  # noqa: E731
    B, C = pad(first), pad(second)
    A1, A2, B1, B2, C1, C2 = diagonal[::2], diagonal[1::2], B[::2], B[1::2], C[::2], C[1::2]
    zero = jnp.zeros_like(A1)
    rows = lambda *blocks: jnp.concatenate(blocks, axis=2)  # noqa: E731
    transposed = jnp.swapaxes(B2, 1, 2)
    right = jnp.concatenate([rows(A1, transposed), rows(B2, A2)], axis=1)
    cross = jnp.concatenate([rows(C1, B1), rows(zero, C2)], axis=1)
    slope = -pad(b).reshape(-1, 2 * m)
    return _Range(jnp.zeros_like(right), cross, right, jnp.zeros_like(slope), slope)
