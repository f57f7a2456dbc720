"""Gathers of rows by index and sums of rows by group, cheaper where the index is static.

A NumPy index is static, that is known while a program is traced, and is compiled to slices. An
index that is a JAX array is known only at run time and is compiled to a gather or a scatter.
"""

import itertools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from jaxsim.arrays import tuning

Index = Int[Array, "n"] | np.ndarray


def gather(x: jax.Array | np.ndarray, index: Index) -> Any:
    """`x[index]` for a static or a traced index; a NumPy array if both arguments are NumPy."""
    if not isinstance(index, np.ndarray):
        return jnp.asarray(x)[index]
    return x[index] if isinstance(x, np.ndarray) else take(x, index)


def gather_or_zero(x: jax.Array, index: Index) -> jax.Array:
    """`x[index]`, with rows of zeros where the index is -1."""
    if isinstance(index, np.ndarray) and (index >= 0).all():
        return take(x, index)
    padded = jnp.concatenate([x, jnp.zeros((1, *x.shape[1:]), x.dtype)])
    if isinstance(index, np.ndarray):
        return take(padded, np.where(index < 0, len(x), index))
    return padded[index]


def take(x: jax.Array, index: np.ndarray) -> jax.Array:
    """`x[index]` for a static index: by slices if these are few, else by one gather."""
    index = np.asarray(index, int)
    if len(index) == x.shape[0] and np.array_equal(index, np.arange(len(index))):
        return x
    if len(index) and (index == index[0]).all():
        return jnp.broadcast_to(x[index[0]][None], (len(index), *x.shape[1:]))
    # Split into runs of consecutive rows in which every row is repeated equally often.
    first = np.concatenate([[0], np.nonzero(np.diff(index))[0] + 1]) if len(index) else index
    row, times = index[first], np.diff(first, append=len(index))
    cuts = np.nonzero((np.diff(row) != 1) | (np.diff(times) != 0))[0] + 1
    runs = list(zip(np.split(row, cuts), np.split(times, cuts), strict=True))
    if len(runs) > tuning.SLICES:
        return x.at[index].get(mode="promise_in_bounds")
    parts = [_repeated(x[r[0] : r[-1] + 1], int(n[0])) for r, n in runs if len(r)]
    return jnp.concatenate(parts) if parts else x[:0]


def _repeated(x: jax.Array, times: int) -> jax.Array:
    """Each row of x repeated `times` times in a row."""
    if times == 1:
        return x
    repeated = jnp.broadcast_to(x[:, None], (len(x), times, *x.shape[1:]))
    return repeated.reshape(-1, *x.shape[1:])


def sum_by(x: jax.Array, group: Index, n: int) -> jax.Array:
    """(n, ...) sum of the rows of `x` in each of n groups.

    Args:
      x: (m, ...) rows.
      group: (m,) the group of each row, static or traced.
      n: number of groups.
    """
    if isinstance(group, jax.Array):
        return jnp.zeros((n, *x.shape[1:]), x.dtype).at[group].add(x)
    group = np.asarray(group, int)
    if np.array_equal(group, np.arange(n)):
        return x
    size = np.bincount(group, minlength=n)
    # Runs of consecutive groups of equal size are blocks of the sorted rows.
    starts = np.concatenate([[0], np.nonzero(np.diff(size))[0] + 1, [n]]) if n else np.zeros(1, int)
    if len(starts) > tuning.SLICES:
        return jnp.zeros((n, *x.shape[1:]), x.dtype).at[group].add(x)
    rows = np.argsort(group, kind="stable")
    parts, row = [x[:0]], 0
    for first, last in itertools.pairwise(starts.tolist()):
        members = rows[row : row + (last - first) * int(size[first])].reshape(last - first, -1)
        parts.append(_sums(x, members))
        row += members.size
    return jnp.concatenate(parts)


def _sums(x: jax.Array, members: np.ndarray) -> jax.Array:
    """(n, ...) sums of rows of `x`; `members` (n, size) are the rows of n groups of equal size."""
    n, size = members.shape
    if size > tuning.SUMMED_ROWS:
        return take(x, members.ravel()).reshape(n, size, *x.shape[1:]).sum(1)
    if size == 0:
        return jnp.zeros((n, *x.shape[1:]), x.dtype)
    total = take(x, members[:, 0])
    for k in range(1, size):
        total = total + take(x, members[:, k])
    return total
