"""Factorisations and triangular solves of small matrices, with lanes last.

Cholesky factors and substitutions of a few rows are unrolled. For more rows XLA's fusion would
recompute columns, so a CPU loops over columns, with one fused update of (rows, lanes) in each
iteration. On a GPU each iteration would be a kernel launch, so it uses the library's batched
routine. LU factors, which permute rows, are loops. Larger matrices are left to `lapack`; the limits
are in `jaxsim.arrays.tuning`.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax

from jaxsim.arrays import tuning
from jaxsim.batching import jaxprs
from jaxsim.batching.primitives import lapack
from jaxsim.batching.primitives.derivatives import with_jvp
from jaxsim.batching.registry import register


def cholesky(lanes, eqn, values, flags):
    """Lower Cholesky factor; NaN where the matrix is not positive definite.

    Only the value is computed here; the derivative is that of the primitive.
    """
    aval = eqn.invars[0].aval
    rows = aval.shape[-1]
    if rows > tuning.LOOPED_ROWS or rows == 0 or jnp.issubdtype(aval.dtype, jnp.complexfloating):
        return lapack.one_by_one(lanes, eqn, values, flags)

    unrolled = rows <= tuning.UNROLLED_ROWS

    def factor(a):
        a = jnp.moveaxis(a, (-3, -2), (0, 1))
        lower = factor_unrolled(a) if unrolled else factor_loop(a)
        diagonal = jnp.stack([lower[j, j] for j in range(rows)])
        lower = jnp.where(jnp.all(diagonal > 0, 0)[None, None], lower, jnp.nan)
        return [jnp.moveaxis(lower, (0, 1), (-3, -2))]

    batched = factor if unrolled else _on_cpu(factor, _batch_first(lanes, eqn, flags))
    return with_jvp(lanes, eqn, flags, batched)(*values)


def factor_unrolled(a):
    """The factor of `a` (n, n, ..., lanes)."""
    columns = []
    for j in range(len(a)):
        column = a[j:, j]
        for previous in columns:
            column = column - previous[j:] * previous[j][None]
        column = column * lax.rsqrt(column[0])[None]
        columns.append(jnp.concatenate([jnp.zeros_like(a[:j, j]), column]))
    return jnp.stack(columns, 1)


def factor_loop(a):
    """The factor of `a`, by a loop over columns."""
    rows = _row_numbers(a[0])

    def column(j, lower):
        row_j = lax.dynamic_index_in_dim(lower, j, 0, keepdims=False)

        def subtract(k, rest):
            previous = lax.dynamic_index_in_dim(lower, k, 1, keepdims=False)
            return rest - previous * lax.dynamic_index_in_dim(row_j, k, 0)

        rest = lax.fori_loop(0, j, subtract, lax.dynamic_index_in_dim(a, j, 1, keepdims=False))
        scaled = rest * lax.rsqrt(lax.dynamic_index_in_dim(rest, j, 0))
        return lax.dynamic_update_index_in_dim(lower, jnp.where(rows >= j, scaled, 0), j, 1)

    return lax.fori_loop(0, len(a), column, jnp.zeros_like(a))


def lu(lanes, eqn, values, flags):
    """LU factors with partial pivoting: L below the diagonal of U, pivots and permutation."""
    aval = eqn.invars[0].aval
    rows, columns = aval.shape[-2:]
    real = not jnp.issubdtype(aval.dtype, jnp.complexfloating)
    if not (real and 0 < rows == columns <= tuning.UNROLLED_ROWS):
        return lapack.one_by_one(lanes, eqn, values, flags)
    factor = factor_pivoted
    for _ in range(aval.ndim - 2):
        factor = jax.vmap(factor)
    loop = lambda *xs: lanes.apply(factor, xs, flags)  # noqa: E731
    return with_jvp(lanes, eqn, flags, _on_cpu(loop, _batch_first(lanes, eqn, flags)))(*values)


def factor_pivoted(a):
    """`lax.linalg.lu` of one matrix (n, n), by a loop over columns.

    As in LAPACK, a column whose possible pivots are all zero is not changed.
    """
    rows = jnp.arange(len(a), dtype=jnp.int32)

    def eliminate(j, state):
        a, swaps, order = state
        choice = jnp.argmax(jnp.where(rows >= j, jnp.abs(a[:, j]), -1)).astype(jnp.int32)
        here, there, below = rows == j, rows == choice, rows > j
        a, order = _swap(a, j, here, there), _swap(order, j, here, there)
        pivot = a[j, j]
        scaled = a[:, j] / jnp.where(pivot == 0, 1, pivot)
        rest = a - jnp.outer(scaled, jnp.where(below, a[j], 0))
        rest = jnp.where(here[None], scaled[:, None], rest)
        return jnp.where(below[:, None], rest, a), jnp.where(here, choice, swaps), order

    return list(lax.fori_loop(0, len(a), eliminate, (a, rows, rows)))


def _swap(x, j, here, there):
    """Exchange row j, whose mask is `here`, with the row whose mask is `there`."""
    here, there = (mask.reshape(-1, *[1] * (x.ndim - 1)) for mask in (here, there))
    this = lax.dynamic_index_in_dim(x, j)
    other = jnp.sum(jnp.where(there, x, 0), 0, keepdims=True, dtype=x.dtype)
    return jnp.where(here, other, jnp.where(there, this, x))


def triangular_solve(lanes, eqn, values, flags):
    """Solve a x = b, or x a = b, in the form a x = b with the solved axis in front."""
    a_type, b_type = (v.aval for v in eqn.invars)
    rows = a_type.shape[-1]
    columns = b_type.shape[-1] if eqn.params["left_side"] else b_type.shape[-2]
    small, medium = rows <= tuning.UNROLLED_ROWS, rows * columns <= tuning.LOOPED_ENTRIES
    real = not jnp.issubdtype(a_type.dtype, jnp.complexfloating)
    if not (real and (small or medium)) or 0 in b_type.shape:
        return _solve_large(lanes, eqn, values, flags)
    a = values[0] if flags[0] else values[0][..., None]
    b = lanes.broadcast(values[1], flags[1])
    if small:
        return [_solve_small(eqn.params, a, b)]
    return [_solve_medium(eqn, lanes, flags, values[0], b)]


def _solve_small(p, a, b):
    x = substitute_unrolled(*_orient(p, a), _axis_in_front(p, b), p["unit_diagonal"])
    return jnp.moveaxis(x, 0, _solved_axis(p))


def _solve_medium(eqn, lanes, flags, a, b):
    """Solve by our loops, as a `custom_linear_solve`, so that its derivatives are solves, too."""
    p, on = eqn.params, [flags[0], True]

    def run(p, b):
        def loop(a, b):
            full = a if flags[0] else a[..., None]
            x = substitute_loop(*_triangle(p, full), _axis_in_front(p, b), p["unit_diagonal"])
            return [jnp.moveaxis(x, 0, _solved_axis(p))]

        library = _batch_first(lanes, eqn, on, p)
        return _on_cpu(loop, library)(a, b)[0]

    def product(x):
        full, lower = _orient(p, a if flags[0] else a[..., None])
        rows = jnp.arange(len(full))
        keep = rows[:, None] >= rows[None] if lower else rows[:, None] <= rows[None]
        keep = keep.reshape(keep.shape + (1,) * (full.ndim - 2))
        full = jnp.where(keep, full, 0)
        if p["unit_diagonal"]:
            same = jnp.eye(len(full), dtype=bool).reshape(keep.shape)
            full = jnp.where(same, 1, full)
        x = _axis_in_front(p, x)
        out = sum(full[:, k] * x[k][None] for k in range(len(full)))
        return jnp.moveaxis(out, 0, _solved_axis(p))

    transposed = {**p, "transpose_a": not p["transpose_a"]}
    return lax.custom_linear_solve(
        product, b, lambda _, b: run(p, b), lambda _, b: run(transposed, b)
    )


def _solve_large(lanes, eqn, values, flags):
    """Solve by the library; if all lanes share the matrix, in one call with more columns."""
    if not flags[0] and eqn.invars[0].aval.ndim == 2:
        return None
    return lapack.one_by_one(lanes, eqn, values, flags)


def substitute_unrolled(a, lower: bool, b, unit: bool):
    """Solve a x = b for triangular a (n, n, ..., 1, lanes) and b (n, ..., m, lanes)."""
    x: dict = {}
    for j in range(len(a)) if lower else reversed(range(len(a))):
        rest = b[j]
        for k, x_k in x.items():
            rest = rest - a[j, k] * x_k
        x[j] = rest if unit else rest / a[j, j]
    return jnp.stack([x[j] for j in range(len(a))])


def substitute_loop(a, column_axis: int, lower: bool, b, unit: bool):
    """As `substitute_unrolled`, by a loop that eliminates one unknown from all remaining rows."""
    rows, n = _row_numbers(b), len(a)

    def eliminate(i, rest):
        j = i if lower else n - 1 - i
        column = lax.dynamic_index_in_dim(a, j, column_axis, keepdims=False)
        x_j = lax.dynamic_index_in_dim(rest, j, 0)
        if not unit:
            x_j = x_j / lax.dynamic_index_in_dim(column, j, 0)
        left = rows > j if lower else rows < j
        rest = jnp.where(left, rest - column * x_j, rest)
        return jnp.where(rows == j, x_j, rest)

    return lax.fori_loop(0, n, eliminate, b)


def _triangle(p, a):
    """The matrix (n, n, ..., 1, lanes), the axis of its columns, and whether it is lower.

    Axes are not moved: columns are along axis 0 if it acts from the right or is transposed.
    """
    flip = p["transpose_a"] == p["left_side"]
    a = jnp.expand_dims(jnp.moveaxis(a, (-3, -2), (0, 1)), -2)
    return a, 0 if flip else 1, p["lower"] != flip


def _orient(p, a):
    """The matrix with rows in front, and whether it is lower."""
    a, column_axis, lower = _triangle(p, a)
    return (a if column_axis == 1 else jnp.swapaxes(a, 0, 1)), lower


def _solved_axis(p) -> int:
    return -3 if p["left_side"] else -2


def _axis_in_front(p, b):
    return jnp.moveaxis(b, _solved_axis(p), 0)


def _row_numbers(x):
    return jnp.arange(len(x)).reshape((-1,) + (1,) * (x.ndim - 1))


def _batch_first(lanes, eqn, flags, parameters=None) -> Callable:
    """The library's routine with the batch first."""
    axes = [-1 if f else None for f in flags]
    p = eqn.params if parameters is None else parameters
    routine = jaxprs.rebind(eqn.replace(params=p))
    return jax.vmap(routine, axes, -1, axis_size=lanes.size)


def _on_cpu(loop: Callable, otherwise: Callable) -> Callable:
    return lambda *xs: lax.platform_dependent(*xs, cpu=loop, default=otherwise)


register("cholesky", rule=cholesky)
register("lu", rule=lu)
register("triangular_solve", rule=triangular_solve)
