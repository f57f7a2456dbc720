"""Rules of primitives with indices: free where these are known, else arrays in memory."""

import itertools

import numpy as np

from jaxsim.lanes.translate import rule

LARGEST_SCATTER = 20_000
COMBINE = {
    "scatter": None,
    "scatter-add": "add",
    "scatter_add": "add",
    "scatter-mul": "mul",
    "scatter_mul": "mul",
    "scatter_min": "min",
    "scatter_max": "max",
    "scatter-min": "min",
    "scatter-max": "max",
}


def strides(shape) -> np.ndarray:
    """How far apart neighbours along each axis are."""
    return np.array([int(np.prod(shape[i + 1 :], dtype=int)) for i in range(len(shape))], int)


def window(shape, sizes) -> np.ndarray:
    """Distances of the elements of a window from its first."""
    out = np.zeros((), int)
    for size, stride in zip(sizes, strides(shape), strict=True):
        out = out[..., None] + np.arange(size) * stride
    return out


def clamped(t, index: np.ndarray, last: int) -> np.ndarray:
    """An index between 0 and the last."""
    if not index.size or last == 0:
        return np.broadcast_to(t.constants(np.int32(0)), index.shape)
    dtype_index = t.apply("max", t.like(index, 0), index)
    return t.convert(t.apply("min", dtype_index, t.like(index, last)), np.dtype("int32"))


def at(t, x: np.ndarray, start: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    """Elements start + offsets of the flat array x; start are nodes, within bounds."""
    shape = np.broadcast_shapes(start.shape, offsets.shape)
    if not int(np.prod(shape, dtype=int)):
        return np.zeros(shape, np.int32)
    start, offsets = np.broadcast_to(start, shape), np.broadcast_to(offsets, shape)
    flat = np.ascontiguousarray(x).reshape(-1)
    if t.is_const(start).all():
        return flat[t.values(start) + offsets]
    return t.load(t.pack(flat), start, offsets.astype(np.int32))


@rule("dynamic_slice")
def dynamic_slice(t, eqn, x, *indices):
    """A window, moved inside where it reaches out."""
    sizes = eqn.params["slice_sizes"]
    return at(t, x, _start(t, x.shape, sizes, indices), window(x.shape, sizes))


def _start(t, shape, sizes, indices):
    start = t.constants(np.int32(0))
    for i, n, size, stride in zip(indices, shape, sizes, strides(shape), strict=True):
        i = clamped(t, i, n - size)
        start = t.apply("add", start, t.apply("mul", i, t.constants(np.int32(stride))))
    return start


@rule("dynamic_update_slice")
def dynamic_update_slice(t, eqn, x, update, *indices):
    """A window replaced."""
    if not update.size:
        return x
    starts = [
        clamped(t, i, n - size) for i, n, size in zip(indices, x.shape, update.shape, strict=True)
    ]
    offsets = window(x.shape, update.shape)
    return placed(t, x, update, starts, offsets, update.shape, None)


def placed(t, x, update, starts, offsets, sizes, combine):
    """An array with a window replaced, or added to and so on, at starts within bounds."""
    flat, shape, step = np.ascontiguousarray(x).reshape(-1).copy(), x.shape, strides(x.shape)
    choices = [
        [int(t.values(s))] if t.is_const(s) else range(n - size + 1)
        for s, n, size in zip(starts, shape, sizes, strict=True)
    ]
    if np.prod([len(c) for c in choices], dtype=float) * max(update.size, 1) > LARGEST_SCATTER:
        raise NotImplementedError("a large array with an index known at run time")
    for choice in itertools.product(*choices):
        where = (int(np.dot(choice, step)) if len(choice) else 0) + offsets
        old = flat[where]
        new = update if combine is None else t.apply(combine, old, update)
        for s, k in zip(starts, choice, strict=True):
            if not t.is_const(s):
                new = t.apply("select", t.apply("eq", s, t.like(s, k)), new, old)
        flat[where] = new
    return flat.reshape(shape)


def _mode(eqn) -> str:
    return str(eqn.params["mode"]).rsplit(".", 1)[-1].lower().split(":")[0]


@rule("gather")
def gather(t, eqn, x, indices):
    """Windows of an array."""
    p, d = eqn.params, eqn.params["dimension_numbers"]
    sizes, mapped = p["slice_sizes"], [int(i) for i in d.start_index_map]
    removed = {int(i) for i in (*d.collapsed_slice_dims, *d.operand_batching_dims)}
    out = eqn.outvars[0].aval
    if not x.size or not out.size:
        return np.broadcast_to(t.constants(np.zeros((), out.dtype)), out.shape)
    start, valid = t.constants(np.int32(0)), t.constants(np.asarray(True))
    for k, axis in enumerate(mapped):
        i, last = indices[..., k], x.shape[axis] - sizes[axis]
        if "fill" in _mode(eqn):
            inside = t.apply(
                "and", t.apply("ge", i, t.like(i, 0)), t.apply("le", i, t.like(i, last))
            )
            valid = t.apply("and", valid, inside)
        stride = t.constants(np.int32(strides(x.shape)[axis]))
        start = t.apply("add", start, t.apply("mul", clamped(t, i, last), stride))
    batch = indices.shape[:-1]
    start = np.broadcast_to(start, batch)
    where = np.zeros(batch, int)
    for axis, of in zip(d.operand_batching_dims, d.start_indices_batching_dims, strict=True):
        counted = np.arange(x.shape[axis]).reshape(
            [-1 if i == of else 1 for i in range(len(batch))]
        )
        where = where + counted * strides(x.shape)[axis]
    kept = [i for i in range(x.ndim) if i not in removed]
    inner = window(x.shape, sizes).reshape([sizes[i] for i in kept])
    ones = (1,) * inner.ndim
    found = at(t, x, start.reshape(*batch, *ones), where.reshape(*batch, *ones) + inner)
    if "fill" in _mode(eqn):
        fill = t.constants(np.asarray(_fill(p.get("fill_value"), out.dtype), out.dtype))
        found = t.apply("select", np.broadcast_to(valid, batch).reshape(*batch, *ones), found, fill)
    rest = [i for i in range(out.ndim) if i not in d.offset_dims]
    return np.moveaxis(found, range(found.ndim), [*rest, *d.offset_dims])


def _fill(value, dtype):
    if value is not None:
        return value
    if dtype.kind == "f":
        return np.nan
    return (
        False
        if dtype.kind == "b"
        else np.iinfo(dtype).min
        if dtype.kind == "i"
        else np.iinfo(dtype).max
    )


@rule(*COMBINE)
def scatter(t, eqn, x, indices, updates):
    """Windows of an array replaced, added to, and so on, one after the other."""
    d = eqn.params["dimension_numbers"]
    if d.operand_batching_dims or not updates.size or not x.size:
        return None if updates.size and x.size else x
    mapped, inserted = list(d.scatter_dims_to_operand_dims), set(d.inserted_window_dims)
    kept = [i for i in range(x.ndim) if i not in inserted]
    outer = [i for i in range(updates.ndim) if i not in d.update_window_dims]
    parts = updates.transpose([*outer, *d.update_window_dims])
    parts = parts.reshape(-1, *[updates.shape[i] for i in d.update_window_dims])
    sizes = [1] * x.ndim
    for axis, size in zip(kept, parts.shape[1:], strict=True):
        sizes[axis] = size
    offsets = window(x.shape, sizes).reshape(parts.shape[1:])
    combine = COMBINE[eqn.primitive.name]
    for index, update in zip(indices.reshape(-1, indices.shape[-1]), parts, strict=True):
        x = _scatter_one(t, x, index, update, mapped, sizes, offsets, combine, _mode(eqn))
    return x


def _scatter_one(t, x, index, update, mapped, sizes, offsets, combine, mode):
    starts, inside = [t.constants(np.int32(0))] * x.ndim, t.constants(np.asarray(True))
    for i, axis in zip(index, mapped, strict=True):
        last = x.shape[axis] - sizes[axis]
        if "clip" not in mode:
            both = t.apply("and", t.apply("ge", i, t.like(i, 0)), t.apply("le", i, t.like(i, last)))
            inside = t.apply("and", inside, both)
        starts[axis] = clamped(t, i, last)
    new = placed(t, x, update, starts, offsets, sizes, combine)
    return t.apply("select", inside, new, x)
