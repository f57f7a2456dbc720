"""Functions for all lanes: sine, cosine, exponential, logarithm by polynomials, others by libm.

Polynomials are evaluated in double precision also where the result is single, which is then right
to one unit in the last place. Angles are reduced by three parts of pi / 2 (Cody and Waite); the
polynomials are those of FreeBSD's msun. Angles of 100,000 and more go to the C library, lane by
lane.
"""

import math
from collections.abc import Sequence

import numpy as np

from jaxsim.lanes.code.instructions import Instructions
from jaxsim.lanes.program.types import CODES, DTYPES, INT32, scalar_name

BINARY = ("atan2", "pow", "rem")
DOUBLE, INT64 = CODES[np.dtype("float64")], CODES[np.dtype("int64")]

SINE = (
    -1.66666666666666324348e-01,
    8.33333333332248946124e-03,
    -1.98412698298579493134e-04,
    2.75573137070700676789e-06,
    -2.50507602534068634195e-08,
    1.58969099521155010221e-10,
)
COSINE = (
    4.16666666666666019037e-02,
    -1.38888888888741095749e-03,
    2.48015872894767294178e-05,
    -2.75573143513906633035e-07,
    2.08757232129817482790e-09,
    -1.13596475577881948265e-11,
)
# Parts of pi / 2 with 33 bits, so that their products with small whole numbers are exact.
HALF_PI = (1.57079632673412561417e00, 6.07710050630396597660e-11, 2.02226624871116645580e-21)
LARGEST_ANGLE = 1e5
LN2 = (6.93147180369123816490e-01, 1.90821492927058770002e-10)
LOGARITHM = (
    6.666666666666735130e-01,
    3.999999999940941908e-01,
    2.857142874366239149e-01,
    2.222219843214978396e-01,
    1.818357216161805012e-01,
    1.531383769920937332e-01,
    1.479819860511658591e-01,
)


def library(code: Instructions) -> list[str]:
    """Definitions of all functions that were called."""
    lines: list[str] = []
    done: set[tuple[str, int]] = set()
    while code.library - done:
        for name, kind in sorted(code.library - done):
            done.add((name, kind))
            write = VECTORISED.get(name) if code.width > 1 else None
            lines += _scalar_calls(code, name, kind) if write is None else write(code, kind)
    return lines


def _scalar_calls(code: Instructions, name: str, kind: int, suffix: str = "") -> list[str]:
    """One call of the C library for each lane."""
    vector, scalar = code.vector(kind), scalar_name(kind)
    count = 2 if name in BINARY else 1
    symbol = name + ("f" if DTYPES[kind].itemsize == 4 else "")
    code.declared[f"@{symbol}"] = f"declare {scalar} @{symbol}({', '.join([scalar] * count)})"
    arguments = ", ".join(f"{vector} %x{i}" for i in range(count))
    title = f"@{name}{suffix}_{code.suffix(kind)}"
    lines = [f"define internal {vector} {title}({arguments}) noinline {{"]
    if code.width == 1:
        operands = ", ".join(f"{scalar} %x{i}" for i in range(count))
        return [*lines, f"  %r = call {scalar} @{symbol}({operands})", f"  ret {vector} %r", "}"]
    result = "poison"
    for lane in range(code.width):
        names = []
        for i in range(count):
            names.append(f"{scalar} %x{i}_{lane}")
            lines.append(f"  %x{i}_{lane} = extractelement {vector} %x{i}, i32 {lane}")
        lines.append(f"  %y{lane} = call {scalar} @{symbol}({', '.join(names)})")
        lines.append(f"  %r{lane} = insertelement {vector} {result}, {scalar} %y{lane}, i32 {lane}")
        result = f"%r{lane}"
    return [*lines, f"  ret {vector} {result}", "}"]


class Function:
    """Writes a function of one argument, in double precision; operators make instructions."""

    def __init__(self, code: Instructions, name: str, kind: int):
        self.code, self.kind, self.name = code, kind, name
        vector = code.vector(kind)
        self.lines = [
            f"define internal {vector} @{name}_{code.suffix(kind)}({vector} %x) noinline {{",
            "entry:",
        ]
        self.x = "%x" if kind == DOUBLE else self.make("convert", [kind], DOUBLE, "%x")

    def make(self, name: str, kinds: Sequence[int], result: int, *xs: str) -> str:
        """One instruction."""
        out = self.code.fresh()
        lines = self.code.operation(out, name, kinds, result, xs)
        self.lines += ["  " + line for line in lines]
        return out

    def number(self, value: float) -> str:
        """A constant."""
        return self.code.splat(value, DOUBLE)

    def __call__(self, name: str, *xs) -> str:
        """An operation on doubles; Python's numbers are constants."""
        operands = [self.number(x) if isinstance(x, int | float) else x for x in xs]
        result = 0 if name in ("lt", "gt", "le", "ge", "eq", "ne") else DOUBLE
        return self.make(name, [DOUBLE] * len(xs), result, *operands)

    def fma(self, a, b, c) -> str:
        """A b + c, rounded once where the processor can."""
        xs = [self.number(x) if isinstance(x, int | float) else x for x in (a, b, c)]
        out = self.code.fresh()
        self.lines.append("  " + self.code.call(out, "fma", DOUBLE, xs))
        return out

    def polynomial(self, x: str, coefficients: Sequence[float]) -> str:
        """c0 + c1 x + c2 x x + ... by Horner's rule."""
        out: str | float = coefficients[-1]
        for c in reversed(coefficients[:-1]):
            out = self.fma(out, x, c)
        return str(out)

    def select(self, condition: str, a, b) -> str:
        """The first where the condition holds."""
        a, b = (self.number(v) if isinstance(v, int | float) else v for v in (a, b))
        return self.make("select", [0, DOUBLE, DOUBLE], DOUBLE, condition, a, b)

    def result(self, value: str) -> str:
        """A double as the type of the function."""
        return value if self.kind == DOUBLE else self.make("convert", [DOUBLE], self.kind, value)

    def done(self, value: str, rare: str | None = None) -> list[str]:
        """The function; where `rare` holds in a lane, the C library computes all lanes."""
        code, vector = self.code, self.code.vector(self.kind)
        value = self.result(value)
        if rare is None:
            return [*self.lines, f"  ret {vector} {value}", "}"]
        bit, slow = code.fresh(), code.fresh()
        self.lines += ["  " + line for line in code.any_lane(bit, rare)]
        self.lines += [
            f"  br i1 {bit}, label %slow, label %fast",
            "fast:",
            f"  ret {vector} {value}",
            "slow:",
            f"  {slow} = call {vector} @{self.name}_slow_{code.suffix(self.kind)}({vector} %x)",
            f"  ret {vector} {slow}",
            "}",
        ]
        return [*self.lines, *_scalar_calls(code, self.name, self.kind, "_slow")]


def _trigonometric(name: str):
    """Sine, or cosine as the sine of a quarter turn more."""

    def write(code: Instructions, kind: int) -> list[str]:
        f = Function(code, name, kind)
        x = f.x
        turns = f("round_even", f("mul", x, 2 / math.pi))
        r = x
        for part in HALF_PI:
            r = f.fma(f("neg", turns), part, r)
        square = f("mul", r, r)
        sine = f.fma(f("mul", square, r), f.polynomial(square, SINE), r)
        half = f.fma(square, -0.5, 1.0)
        cosine = f.fma(f("mul", square, square), f.polynomial(square, COSINE), half)
        quarter = f.make("convert", [DOUBLE], INT32, turns)
        if name == "cos":
            quarter = f.make("add", [INT32] * 2, INT32, quarter, code.splat(1, INT32))
        bit = lambda n: f.make(  # noqa: E731
            "ne",
            [INT32] * 2,
            0,
            f.make("and", [INT32] * 2, INT32, quarter, code.splat(n, INT32)),
            code.splat(0, INT32),
        )
        value = f.select(bit(1), cosine, sine)
        value = f.select(bit(2), f("neg", value), value)
        small = f("lt", f("abs", x), LARGEST_ANGLE)
        return f.done(value, f.make("not", [0], 0, small))

    return write


def _scaled(f: Function, value: str, exponent: str) -> str:
    """Value 2^exponent, by two factors so that the result may be subnormal."""
    code = f.code
    whole = f.make("convert", [DOUBLE], INT64, exponent)
    half = f.make("shift_right_arithmetic", [INT64] * 2, INT64, whole, code.splat(1, INT64))
    rest = f.make("sub", [INT64] * 2, INT64, whole, half)
    for part in (half, rest):
        biased = f.make("add", [INT64] * 2, INT64, part, code.splat(1023, INT64))
        bits = f.make("shift_left", [INT64] * 2, INT64, biased, code.splat(52, INT64))
        factor = code.fresh()
        f.lines.append(f"  {factor} = bitcast {code.vector(INT64)} {bits} to {code.vector(DOUBLE)}")
        value = f("mul", value, factor)
    return value


def _exponential(code: Instructions, kind: int) -> list[str]:
    """2^k e^r with |r| at most ln 2 / 2, and the series of e^r."""
    f = Function(code, "exp", kind)
    x = f("max", f("min", f.x, 710.0), -750.0)
    k = f("round_even", f("mul", x, 1 / math.log(2)))
    r = f.fma(f("neg", k), LN2[1], f.fma(f("neg", k), LN2[0], x))
    terms = 8 if kind != DOUBLE else 14
    value = f.polynomial(r, [1 / math.factorial(i) for i in range(terms)])
    return f.done(_scaled(f, value, k))


def _logarithm(code: Instructions, kind: int) -> list[str]:
    """K ln 2 + ln m with m between sqrt(1/2) and sqrt(2), by the series of atanh."""
    f = Function(code, "log", kind)
    tiny = f("lt", f.x, 2.3e-308)
    x = f.select(tiny, f("mul", f.x, 2.0**54), f.x)
    bits, m = code.fresh(), code.fresh()
    wide, real = code.vector(INT64), code.vector(DOUBLE)
    f.lines.append(f"  {bits} = bitcast {real} {x} to {wide}")
    whole = [INT64] * 2
    exponent = f.make(
        "sub",
        whole,
        INT64,
        f.make("shift_right_arithmetic", whole, INT64, bits, code.splat(52, INT64)),
        code.splat(1023, INT64),
    )
    fraction = f.make("and", whole, INT64, bits, code.splat((1 << 52) - 1, INT64))
    one = f.make("or", whole, INT64, fraction, code.splat(1023 << 52, INT64))
    f.lines.append(f"  {m} = bitcast {wide} {one} to {real}")
    large = f("gt", m, math.sqrt(2))
    m = f.select(large, f("mul", m, 0.5), m)
    k = f.make("convert", [INT64], DOUBLE, exponent)
    k = f.select(large, f("add", k, 1.0), k)
    k = f.select(tiny, f("sub", k, 54.0), k)
    g = f("sub", m, 1.0)
    s = f("div", g, f("add", g, 2.0))
    z = f("mul", s, s)
    rest = f("mul", z, f.polynomial(z, LOGARITHM))
    half = f("mul", f("mul", g, g), 0.5)
    inner = f.fma(s, f("add", half, rest), f("mul", k, LN2[1]))
    value = f("sub", f("mul", k, LN2[0]), f("sub", f("sub", half, inner), g))
    value = f.select(f("eq", f.x, 0.0), -math.inf, value)
    value = f.select(f("lt", f.x, 0.0), math.nan, value)
    value = f.select(f("eq", f.x, math.inf), math.inf, value)
    return f.done(f.select(f("ne", f.x, f.x), f.x, value))


VECTORISED = {
    "sin": _trigonometric("sin"),
    "cos": _trigonometric("cos"),
    "exp": _exponential,
    "log": _logarithm,
}
