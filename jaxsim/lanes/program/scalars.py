"""Scalar operations by name: their numbers, and what they compute of constants."""

import math
from collections.abc import Callable

import numpy as np

from jaxsim.lanes.program.graph import FIRST_OPERATION


def _integer_quotient(a, b):
    safe = np.where(b == 0, 1, b)
    return np.where(b == 0, -1, np.sign(a) * np.sign(safe) * (abs(a) // abs(safe))).astype(a.dtype)


def _divide(a, b):
    return a / b if a.dtype.kind == "f" else _integer_quotient(a, b)


def _remainder(a, b):
    if a.dtype.kind == "f":
        return np.fmod(a, b)
    return np.where(b == 0, a, a - b * _integer_quotient(a, b)).astype(a.dtype)


def _shift(function: Callable) -> Callable:
    def shifted(a, b):
        bits = 8 * a.dtype.itemsize
        inside = (b >= 0) & (b < bits)
        return np.where(inside, function(a, np.where(inside, b, 0)), 0).astype(a.dtype)

    return shifted


def _logical_right(a, b):
    unsigned = np.dtype(f"u{a.dtype.itemsize}")
    return (a.view(unsigned) >> b.astype(unsigned)).view(a.dtype)


def _arithmetic_right(a, b):
    return (a >> np.clip(b, 0, 8 * a.dtype.itemsize - 1)).astype(a.dtype)


def _leading_zeros(x):
    unsigned, bits = x.view(f"u{x.dtype.itemsize}"), 8 * x.dtype.itemsize
    found = [bits - int(v).bit_length() for v in unsigned.reshape(-1)]
    return np.array(found, x.dtype).reshape(x.shape)


def _libm(name: str) -> Callable:
    function = getattr(math, name)
    return lambda x: np.array([function(v) for v in x.reshape(-1)], x.dtype).reshape(x.shape)


NUMPY: dict[str, Callable] = {
    "add": np.add,
    "sub": np.subtract,
    "mul": np.multiply,
    "div": _divide,
    "rem": _remainder,
    "neg": np.negative,
    "max": np.maximum,
    "min": np.minimum,
    "abs": np.abs,
    "sqrt": np.sqrt,
    "floor": np.floor,
    "ceil": np.ceil,
    "round_even": np.rint,
    "round_away": lambda x: np.copysign(np.floor(np.abs(x) + x.dtype.type(0.5)), x),
    "and": np.bitwise_and,
    "or": np.bitwise_or,
    "xor": np.bitwise_xor,
    "not": np.invert,
    "shift_left": _shift(np.left_shift),
    "shift_right_logical": _shift(_logical_right),
    "shift_right_arithmetic": _arithmetic_right,
    "lt": np.less,
    "le": np.less_equal,
    "gt": np.greater,
    "ge": np.greater_equal,
    "eq": np.equal,
    "ne": np.not_equal,
    "select": lambda p, a, b: np.where(p, a, b),
    "any": lambda x: x,
    "population_count": lambda x: np.bitwise_count(x).astype(x.dtype),
    "clz": _leading_zeros,
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "asin": np.arcsin,
    "acos": np.arccos,
    "atan": np.arctan,
    "sinh": np.sinh,
    "cosh": np.cosh,
    "tanh": np.tanh,
    "asinh": np.arcsinh,
    "acosh": np.arccosh,
    "atanh": np.arctanh,
    "exp": np.exp,
    "exp2": np.exp2,
    "expm1": np.expm1,
    "log": np.log,
    "log1p": np.log1p,
    "cbrt": np.cbrt,
    "erf": _libm("erf"),
    "erfc": _libm("erfc"),
    "atan2": np.arctan2,
    "pow": np.power,
}
"""From arrays of constants to their results; `convert` and `reinterpret` are apart."""

NAMES = ["convert", "reinterpret", *NUMPY]
OPS = {name: FIRST_OPERATION + i for i, name in enumerate(NAMES)}
COMPARISONS = frozenset("lt le gt ge eq ne".split())
COMMUTATIVE = frozenset("add mul and or xor".split())
LIBM = frozenset(NAMES[NAMES.index("sin") :])
"""Operations that are functions of the C library, of one or two operands."""


def name_of(op: int) -> str:
    """The name of an operation's number."""
    return NAMES[op - FIRST_OPERATION]


def fold(name: str, operands) -> np.ndarray:
    """An operation on arrays of constants, in their own precision."""
    with np.errstate(all="ignore"):
        return NUMPY[name](*operands)


def saturating(x: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Conversion as XLA's: floats outside an integer type become its ends, NaN zero."""
    if x.dtype.kind == "f" and dtype.kind in "iu":
        info = np.iinfo(dtype)
        inside = np.where(np.isnan(x) | (x <= info.min) | (x >= info.max), 0, x).astype(dtype)
        low = np.where(x <= info.min, dtype.type(info.min), inside)
        return np.where(x >= info.max, dtype.type(info.max), low).astype(dtype)
    with np.errstate(all="ignore"):
        return (x != 0) if dtype.kind == "b" else x.astype(dtype)
