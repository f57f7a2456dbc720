"""Rules of primitives that move numbers and compute nothing."""

import numpy as np

from jaxsim.lanes.translate import rule


@rule("reshape", "squeeze", "expand_dims")
def reshape(t, eqn, x, *rest):
    """Another shape of the same numbers in the same order."""
    if rest or (eqn.primitive.name == "reshape" and eqn.params["dimensions"]):
        return None
    return x.reshape(eqn.outvars[0].aval.shape)


@rule("transpose")
def transpose(t, eqn, x):
    """Axes in another order."""
    return x.transpose(eqn.params["permutation"])


@rule("rev")
def rev(t, eqn, x):
    """Axes in the opposite direction."""
    return np.flip(x, eqn.params["dimensions"])


@rule("broadcast_in_dim")
def broadcast_in_dim(t, eqn, x, *rest):
    """New axes, along which all is the same."""
    shape, where = eqn.params["shape"], eqn.params["broadcast_dimensions"]
    full = [1] * len(shape)
    for size, axis in zip(x.shape, where, strict=True):
        full[axis] = size
    return np.broadcast_to(x.reshape(full), shape)


@rule("slice")
def slice_(t, eqn, x):
    """Part of an array."""
    p = eqn.params
    strides = p["strides"] or (1,) * x.ndim
    parts = zip(p["start_indices"], p["limit_indices"], strides, strict=True)
    return x[tuple(slice(*part) for part in parts)]


@rule("concatenate")
def concatenate(t, eqn, *xs):
    """Arrays one after the other."""
    return np.concatenate(xs, eqn.params["dimension"])


@rule("stack")
def stack(t, eqn, *xs):
    """Arrays along a new axis."""
    return np.stack(xs, eqn.params.get("axis", eqn.params.get("dimension", 0)))


@rule("split")
def split(t, eqn, x):
    """Parts of given sizes."""
    return np.split(x, np.cumsum(eqn.params["sizes"])[:-1], eqn.params["axis"])


@rule("unstack")
def unstack(t, eqn, x):
    """Parts of an axis, without it."""
    return list(np.moveaxis(x, eqn.params["axis"], 0))


@rule("iota")
def iota(t, eqn, *rest):
    """Numbers counted along an axis."""
    p = eqn.params
    axis = np.expand_dims(
        np.arange(p["shape"][p["dimension"]]).astype(p["dtype"]),
        [i for i in range(len(p["shape"])) if i != p["dimension"]],
    )
    return np.broadcast_to(t.constants(axis), p["shape"])


@rule("empty", "empty2")
def empty(t, eqn):
    """Numbers that will be overwritten: the stack of a loop in reverse mode."""
    kind = eqn.outvars[0].aval
    return np.broadcast_to(t.constants(np.zeros((), kind.dtype)), kind.shape)


@rule("pad")
def pad(t, eqn, x, value):
    """Values around and between numbers; a negative width takes numbers away."""
    config = eqn.params["padding_config"]
    for axis, (low, high, inner) in enumerate(config):
        size = x.shape[axis]
        spread = max(size + (size - 1) * inner, 0)
        total = low + spread + high
        out = np.full([*x.shape[:axis], max(total, 0), *x.shape[axis + 1 :]], value.item())
        places = low + np.arange(size) * (inner + 1)
        inside = np.flatnonzero((places >= 0) & (places < total))
        out_view, source = np.moveaxis(out, axis, 0), np.moveaxis(x, axis, 0)
        out_view[places[inside]] = source[inside]
        x = out
    return x.astype(np.int32)
