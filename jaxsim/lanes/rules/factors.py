"""Rules of factorisations and triangular systems, written out."""

import numpy as np

from jaxsim.lanes.translate import rule


@rule("cholesky")
def cholesky(t, eqn, a):
    """The lower factor, column by column; NaN where a pivot is not positive."""
    out = [_cholesky(t, m) for m in a.reshape(-1, *a.shape[-2:])]
    return np.stack(out).reshape(a.shape) if out else a


def _cholesky(t, a):
    n = len(a)
    lower = np.broadcast_to(t.like(a, 0), a.shape).copy()
    positive = t.constants(np.asarray(True))
    for j in range(n):
        column = a[j:, j]
        for k in range(j):
            column = t.apply("sub", column, t.apply("mul", lower[j:, k], lower[j, k]))
        positive = t.apply("and", positive, t.apply("gt", column[0], t.like(a, 0)))
        lower[j, j] = t.apply("sqrt", column[0])
        inverse = t.apply("div", t.like(a, 1), lower[j, j])
        if j + 1 < n:
            lower[j + 1 :, j] = t.apply("mul", column[1:], inverse)
    below = np.tril_indices(n)
    lower[below] = t.apply("select", positive, lower[below], t.like(a, np.nan))
    return lower


@rule("triangular_solve")
def triangular_solve(t, eqn, a, b):
    """Substitution; each pivot is divided by once."""
    p = eqn.params
    batch = [*zip(a.reshape(-1, *a.shape[-2:]), b.reshape(-1, *b.shape[-2:]), strict=True)]
    return np.stack([_solve(t, m, v, p) for m, v in batch]).reshape(b.shape) if b.size else b


def _solve(t, a, b, p):
    lower = p["lower"]
    if p["transpose_a"]:
        a, lower = a.T, not lower
    if not p["left_side"]:
        a, b, lower = a.T, b.T, not lower
    n, x = len(a), b.copy()
    order = range(n) if lower else range(n - 1, -1, -1)
    for i in order:
        if not p["unit_diagonal"]:
            x[i] = t.apply("mul", x[i], t.apply("div", t.like(a, 1), a[i, i]))
        rest = slice(i + 1, None) if lower else slice(0, i)
        if x[rest].size:
            x[rest] = t.apply("sub", x[rest], t.apply("mul", a[rest, i, None], x[i]))
    return x if p["left_side"] else x.T


@rule("lu")
def lu(t, eqn, a):
    """Factors, pivots and order of rows of each square matrix; others are not known."""
    n = a.shape[-1]
    if a.shape[-2] != n:
        return None
    found = [_lu(t, m.copy()) for m in a.reshape(-1, n, n)]
    factors, pivots, order = ([row[k] for row in found] for k in range(3))
    shape = a.shape[:-1]
    return [
        np.array(factors, a.dtype).reshape(a.shape),
        np.array(pivots, np.int32).reshape(shape),
        np.array(order, np.int32).reshape(shape),
    ]


def _lu(t, a):
    """Gaussian elimination with the largest pivot of each column; rows are chosen by selects."""
    n = len(a)
    order, pivots = t.constants(np.arange(n, dtype=np.int32)), []
    for j in range(n):
        best, place = t.apply("abs", a[j, j]), t.constants(np.int32(j))
        for i in range(j + 1, n):
            size = t.apply("abs", a[i, j])
            larger = t.apply("gt", size, best)
            best = t.apply("select", larger, size, best)
            place = t.apply("select", larger, t.constants(np.int32(i)), place)
        for i in range(j + 1, n):
            swap = t.apply("eq", place, t.constants(np.int32(i)))
            a[j], a[i] = t.apply("select", swap, a[i], a[j]), t.apply("select", swap, a[j], a[i])
            order[j], order[i] = (
                t.apply("select", swap, order[i], order[j]),
                t.apply("select", swap, order[j], order[i]),
            )
        pivots.append(place)
        if j + 1 < n:
            nonzero = t.apply("ne", a[j, j], t.like(a, 0))
            safe = t.apply("select", nonzero, a[j, j], t.like(a, 1))
            a[j + 1 :, j] = t.apply("div", a[j + 1 :, j], safe)
            product = t.apply("mul", a[j + 1 :, j, None], a[None, j, j + 1 :])
            a[j + 1 :, j + 1 :] = t.apply("sub", a[j + 1 :, j + 1 :], product)
    return a, pivots, order
