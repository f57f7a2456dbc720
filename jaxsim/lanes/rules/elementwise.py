"""Rules of primitives that act on each number by itself."""

import numpy as np

from jaxsim.lanes.program.scalars import OPS
from jaxsim.lanes.program.types import BOOL, DTYPES
from jaxsim.lanes.translate import rule

APART = "convert", "reinterpret", "select"
DIRECT = {name: name for name in OPS if name not in APART} | {"add_any": "add"}


def _float(builder, x) -> bool:
    return DTYPES[builder.type[x.flat[0]]].kind == "f"


@rule(*DIRECT)
def direct(t, eqn, *values):
    """One operation for each number."""
    name = DIRECT[eqn.primitive.name]
    if not values[0].size:
        return np.zeros(eqn.outvars[0].aval.shape, np.int32)
    kind = t.type[values[0].flat[0]]
    if kind == BOOL and name in ("max", "min", "ne", "eq", "mul", "add"):
        logical = {"max": "or", "min": "and", "ne": "xor", "mul": "and", "add": "or"}
        if name == "eq":
            return t.apply("not", t.apply("xor", *values))
        name = logical[name]
    return t.apply(name, *values)


@rule(
    "optimization_barrier", "stop_gradient", "copy", "copy_p", "name", "reshard", "pcast", "pvary"
)
def same(t, eqn, *values):
    """What serves other compilers or derivatives."""
    return list(values)


@rule("convert_element_type")
def convert_element_type(t, eqn, x):
    """Numbers of another type."""
    return t.convert(x, np.dtype(eqn.params["new_dtype"]))


@rule("bitcast_convert_type")
def bitcast_convert_type(t, eqn, x):
    """The same bits; numbers of eight bytes are two of four, the low one first."""
    old, new = (np.dtype(v.aval.dtype) for v in (eqn.invars[0], eqn.outvars[0]))
    if not x.size:
        return np.zeros(eqn.outvars[0].aval.shape, np.int32)
    if old.itemsize == new.itemsize and "b" not in old.kind + new.kind:
        return t.reinterpret(x, new)
    if (old.itemsize, new.itemsize) == (8, 4):
        bits = t.reinterpret(x, np.dtype(np.uint64))
        high = t.apply("shift_right_logical", bits, t.like(bits, 32))
        halves = [t.convert(half, np.dtype(np.uint32)) for half in (bits, high)]
        return t.reinterpret(np.stack(halves, -1), new)
    if (old.itemsize, new.itemsize) == (4, 8):
        words = t.convert(t.reinterpret(x, np.dtype(np.uint32)), np.dtype(np.uint64))
        high = t.apply("shift_left", words[..., 1], t.like(words, 32))
        return t.reinterpret(t.apply("or", words[..., 0], high), new)
    raise NotImplementedError(f"bits of {old} as {new}")


@rule("select_n")
def select_n(t, eqn, which, *cases):
    """The case for each number."""
    if not cases[0].size:
        return cases[0]
    if len(cases) == 1:
        return cases[0]
    if t.type[which.flat[0]] == BOOL:
        return t.apply("select", which, cases[1], cases[0])
    out = cases[-1]
    for i, case in reversed(list(enumerate(cases[:-1]))):
        out = t.apply("select", t.apply("eq", which, t.like(which, i)), case, out)
    return out


@rule("clamp")
def clamp(t, eqn, low, x, high):
    """min(max(x, low), high)."""
    return t.apply("min", t.apply("max", low, x), high) if x.size else x


@rule("sign")
def sign(t, eqn, x):
    """-1, 0 or 1; zeros and NaN stay themselves."""
    if not x.size:
        return x
    one, zero = t.like(x, 1), t.like(x, 0)
    if DTYPES[t.type[x.flat[0]]].kind == "u":
        return t.apply("min", x, one)
    negative = t.apply("select", t.apply("lt", x, zero), t.like(x, -1), x)
    return t.apply("select", t.apply("gt", x, zero), one, negative)


@rule("square")
def square(t, eqn, x):
    """X times x."""
    return t.apply("mul", x, x) if x.size else x


@rule("rsqrt")
def rsqrt(t, eqn, x):
    """1 / sqrt(x)."""
    return t.apply("div", t.like(x, 1), t.apply("sqrt", x)) if x.size else x


@rule("logistic")
def logistic(t, eqn, x):
    """1 / (1 + exp(-x))."""
    if not x.size:
        return x
    one = t.like(x, 1)
    return t.apply("div", one, t.apply("add", one, t.apply("exp", t.apply("neg", x))))


@rule("is_finite")
def is_finite(t, eqn, x):
    """Neither infinite nor NaN."""
    if not x.size or not _float(t, x):
        return np.broadcast_to(t.constants(np.asarray(True)), x.shape)
    return t.apply("lt", t.apply("abs", x), t.like(x, np.inf))


@rule("integer_pow")
def integer_pow(t, eqn, x):
    """Products by repeated squaring."""
    y = eqn.params["y"]
    if not x.size:
        return x
    if y == 0:
        return np.broadcast_to(t.like(x, 1), x.shape)
    out, power, rest = None, x, abs(y)
    while rest:
        if rest & 1:
            out = power if out is None else t.apply("mul", out, power)
        rest >>= 1
        power = t.apply("mul", power, power) if rest else power
    return t.apply("div", t.like(x, 1), out) if y < 0 else out


@rule("round")
def round_(t, eqn, x):
    """To whole numbers, halves away from zero or to even."""
    if not x.size or not _float(t, x):
        return x
    return t.apply("round_even" if int(eqn.params["rounding_method"]) == 1 else "round_away", x)
