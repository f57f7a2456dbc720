"""Rules of sums and other reductions, products of matrices and sorting."""

import numpy as np

from jaxsim.lanes.program.scalars import OPS
from jaxsim.lanes.program.types import BOOL
from jaxsim.lanes.translate import rule

OPERATION: dict[str, tuple[str, int | bool | None]] = {
    "reduce_sum": ("add", 0),
    "reduce_prod": ("mul", 1),
    "reduce_max": ("max", None),
    "reduce_min": ("min", None),
    "reduce_and": ("and", True),
    "reduce_or": ("or", False),
    "reduce_xor": ("xor", 0),
}
RUNNING = {"cumsum": "add", "cumprod": "mul", "cummax": "max", "cummin": "min"}


def accumulate(t, name: str, rows: np.ndarray) -> np.ndarray:
    """One number of each column, added or so from the first row to the last."""
    out = rows[0]
    for row in rows[1:]:
        out = t.apply(name, out, row)
    return out


@rule(*OPERATION)
def reduce(t, eqn, x):
    """Over some axes."""
    axes = eqn.params["axes"]
    name, neutral = OPERATION[eqn.primitive.name]
    aval = eqn.outvars[0].aval
    kept = [i for i in range(x.ndim) if i not in axes]
    rows = x.transpose([*axes, *kept]).reshape(-1, *aval.shape)
    if not len(rows):
        if neutral is None:
            ends = np.finfo if aval.dtype.kind == "f" else np.iinfo
            low = name == "max"
            neutral = -np.inf if low else np.inf
            if aval.dtype.kind != "f":
                neutral = ends(aval.dtype).min if low else ends(aval.dtype).max
        return np.broadcast_to(t.constants(np.asarray(neutral, aval.dtype)), aval.shape)
    if rows.size and t.type[x.flat[0]] == BOOL:
        name = {"max": "or", "min": "and"}.get(name, name)
    return accumulate(t, name, rows)


@rule(*RUNNING)
def running(t, eqn, x):
    """All partial results along an axis."""
    p = eqn.params
    rows = np.moveaxis(x, p["axis"], 0)
    rows = list(rows[::-1] if p["reverse"] else rows)
    for i in range(1, len(rows)):
        rows[i] = t.apply(RUNNING[eqn.primitive.name], rows[i - 1], rows[i])
    out = np.stack(rows[::-1] if p["reverse"] else rows) if rows else np.moveaxis(x, p["axis"], 0)
    return np.moveaxis(out, 0, p["axis"])


@rule("argmax", "argmin")
def arg_extremum(t, eqn, x):
    """The first place of the largest or smallest number; that of a NaN if there is one."""
    (axis,) = eqn.params["axes"]
    rows = np.moveaxis(x, axis, 0)
    better = "gt" if eqn.primitive.name == "argmax" else "lt"
    dtype = np.dtype(eqn.params["index_dtype"])
    best, place = rows[0], np.broadcast_to(t.constants(np.zeros((), dtype)), rows[0].shape)
    for i, row in enumerate(rows[1:], 1):
        take = t.apply("or", t.apply(better, row, best), t.apply("ne", row, row))
        take = t.apply("and", take, t.apply("eq", best, best))
        best = t.apply("select", take, row, best)
        place = t.apply("select", take, t.constants(np.asarray(i, dtype)), place)
    return place


@rule("dot_general")
def dot_general(t, eqn, a, b):
    """Sums of products, each along one chain of fused multiply-adds."""
    (ac, bc), (ab, bb) = eqn.params["dimension_numbers"]
    dtype = eqn.outvars[0].aval.dtype
    a, b = t.convert(a, dtype), t.convert(b, dtype)
    am = [i for i in range(a.ndim) if i not in ac and i not in ab]
    bm = [i for i in range(b.ndim) if i not in bc and i not in bb]
    batch, rows, columns = ([x.shape[i] for i in axes] for x, axes in ((a, ab), (a, am), (b, bm)))
    size = int(np.prod([a.shape[i] for i in ac], dtype=int))
    if not size:
        return np.broadcast_to(t.constants(np.zeros((), dtype)), eqn.outvars[0].aval.shape)
    ones = lambda axes: (1,) * len(axes)  # noqa: E731
    # A GPU's memory costs more than its operations.
    if t.finite_math and t.for_cpu and not batch and len(ac) == 1:
        left, right = a.transpose([*ac, *am]), b.transpose([*bc, *bm])
        sums = _sums_of_rows(t, left, right)
        if sums is not None:
            return sums
        sums = _sums_of_rows(t, right, left)
        if sums is not None:
            return np.moveaxis(sums, 0, -1)
    a = a.transpose([*ac, *ab, *am]).reshape(size, *batch, *rows, *ones(bm))
    b = b.transpose([*bc, *bb, *bm]).reshape(size, *batch, *ones(am), *columns)
    return accumulate(t, "add", t.apply("mul", a, b))


def _sums_of_rows(t, ones, rows):
    """`ones.T @ rows` by sums in memory, where each row of `ones` has a one at a place.

    The places are known at run time and the same in all lanes. None if this is not so.
    """
    if ones.ndim != 2 or not ones.size or not rows.size:
        return None
    if not (t.op[ones] == OPS["convert"]).all():
        return None
    flag = t.args[ones, 0]
    if not (t.op[flag] == OPS["eq"]).all():
        return None
    place, column = t.args[flag, 0], t.args[flag, 1]
    count = ones.shape[1]
    known = t.is_const(column).all() and (t.values(column) == np.arange(count)).all()
    if not (known and (place == place[:, :1]).all() and t.uniform[place].all()):
        return None
    place = place[:, 0]
    inside = t.apply(
        "and", t.apply("ge", place, t.like(place, 0)), t.apply("lt", place, t.like(place, count))
    )
    flat = rows.reshape(len(rows), -1)
    size = flat.shape[1]
    # Rows without a place are added after the last.
    start = t.apply(
        "mul", t.apply("select", inside, place, t.like(place, count)), t.like(place, size)
    )
    start = t.convert(start, np.dtype(np.int32))
    sums = t.sums_at(start, flat, (count + 1) * size)[: count * size]
    return sums.reshape(count, *rows.shape[1:])


@rule("sort")
def sort(t, eqn, *xs):
    """Batcher's network; the place where a number stood makes the order of equals."""
    axis, keys = eqn.params["dimension"], eqn.params["num_keys"]
    columns = [np.moveaxis(x, axis, 0).copy() for x in xs]
    n = len(columns[0])
    if n < 2 or not columns[0].size:
        return list(xs)
    place = t.constants(np.arange(n, dtype=np.int32)).reshape(n, *[1] * (columns[0].ndim - 1))
    columns.append(np.broadcast_to(place, columns[0].shape).copy())
    order = [*range(keys), len(columns) - 1]
    for low, high in _network(n):
        swap = _before(t, [(columns[k][high], columns[k][low]) for k in order])
        for column in columns:
            first, last = column[low], column[high]
            column[low] = t.apply("select", swap, last, first)
            column[high] = t.apply("select", swap, first, last)
    return [np.moveaxis(c, 0, axis) for c in columns[:-1]]


def _before(t, pairs) -> np.ndarray:
    """Whether the first of each pair comes first, by the pairs in order; NaN comes last."""
    (a, b), *rest = pairs
    less = (
        t.apply("lt", a, b) if t.type[a.flat[0]] != BOOL else t.apply("and", t.apply("not", a), b)
    )
    a_nan, b_nan = t.apply("ne", a, a), t.apply("ne", b, b)
    if t.type[a.flat[0]] == BOOL:
        return less if not rest else _lexicographic(t, less, t.apply("xor", a, b), rest)
    less = t.apply("or", less, t.apply("and", b_nan, t.apply("not", a_nan)))
    if not rest:
        return less
    differ = t.apply("and", t.apply("ne", a, b), t.apply("not", t.apply("and", a_nan, b_nan)))
    return _lexicographic(t, less, differ, rest)


def _lexicographic(t, less, differ, rest):
    return t.apply("select", differ, less, _before(t, rest))


def _network(n: int):
    """Stages of independent comparisons (low places, high places) that sort n numbers."""
    p = 1
    while p < n:
        k = p
        while k:
            low = [
                j + i
                for j in range(k % p, n - k, 2 * k)
                for i in range(min(k, n - j - k))
                if (i + j) // (2 * p) == (i + j + k) // (2 * p)
            ]
            yield np.array(low, int), np.array(low, int) + k
            k //= 2
        p *= 2
