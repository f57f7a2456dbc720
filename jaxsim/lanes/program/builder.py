"""Builds a program of scalar operations: folds, simplifies and shares whole arrays of them.

No simplification changes a number by more than rounding or hides a NaN. So 0 x stays a product
unless x is known or the program asks for finite math; x + 0 becomes x, which differs in the sign of
a zero alone.
"""

import contextlib
import functools
from collections.abc import Iterator

import numpy as np

from jaxsim.lanes.program import scalars
from jaxsim.lanes.program.graph import CONST, LOAD, Graph
from jaxsim.lanes.program.scalars import COMMUTATIVE, COMPARISONS, OPS
from jaxsim.lanes.program.types import BOOL, DTYPES, code

SMALL_POWERS = (2, 3, 4)


class Builder(Graph):
    """A graph to which operations are applied elementwise, on arrays of nodes.

    Args:
      finite_math: whether 0 x is 0.
      for_cpu: whether a CPU runs the program.
    """

    def __init__(self, finite_math: bool = False, for_cpu: bool = True):
        super().__init__()
        self.finite_math, self.for_cpu = finite_math, for_cpu

    @contextlib.contextmanager
    def finite_math_if(self, wanted: bool) -> Iterator[None]:
        """Finite math for a part of the program, if wanted there or around it."""
        before = self.finite_math
        self.finite_math = before or wanted
        yield
        self.finite_math = before

    def apply(self, name: str, *operands) -> np.ndarray:
        """An operation on arrays of nodes, which are broadcast; its results as nodes."""
        arrays = np.broadcast_arrays(*operands)
        flat = np.stack([x.reshape(-1) for x in arrays])
        if not flat.size:
            return np.zeros(arrays[0].shape, np.int32)
        kind = BOOL if name in COMPARISONS else int(self.type[flat[-1, 0]])
        return self._elementwise(name, kind, flat).reshape(arrays[0].shape)

    def convert(self, ids: np.ndarray, dtype: np.dtype) -> np.ndarray:
        """Numbers of another type."""
        target = code(dtype)
        flat = ids.reshape(1, -1)
        if not flat.size or self.type[flat[0, 0]] == target:
            return ids
        if DTYPES[target].kind == "b":
            return self.apply("ne", ids, self.like(ids, 0))
        return self._elementwise("convert", target, flat).reshape(ids.shape)

    def reinterpret(self, ids: np.ndarray, dtype: np.dtype) -> np.ndarray:
        """The same bits as numbers of another type of the same size."""
        target = code(dtype)
        flat = ids.reshape(1, -1)
        if not flat.size or self.type[flat[0, 0]] == target:
            return ids
        return self._elementwise("reinterpret", target, flat).reshape(ids.shape)

    def like(self, ids: np.ndarray, value) -> np.ndarray:
        """A constant of the type of other nodes."""
        return self.constants(np.asarray(value, DTYPES[self.type[ids.flat[0]]]))

    def load(self, pack: int, index: np.ndarray, offset: np.ndarray) -> np.ndarray:
        """Elements index + offset of an array in memory; the sums are within it."""
        known = self.is_const(index)
        elements = self.packs[self.args[pack, 0]]
        if known.all():
            return elements[self.values(index) + offset]
        flat = np.broadcast_arrays(np.int32(pack), index, offset)
        rows = np.stack([x.reshape(-1) for x in flat]).astype(np.int32)
        kind = int(self.type[elements[0]])
        return self.intern(LOAD, kind, rows[:2], rows[2]).reshape(flat[1].shape)

    def _elementwise(self, name: str, kind: int, flat: np.ndarray) -> np.ndarray:
        known = (self.op[flat] == CONST).all(0)
        out = np.full(flat.shape[1], -1, np.int32)
        if known.any():
            out[known] = self._fold(name, kind, flat[:, known])
        rest = np.flatnonzero(~known)
        if len(rest):
            out[rest] = self._simplified(name, kind, flat[:, rest])
        return out

    def _fold(self, name: str, kind: int, flat: np.ndarray) -> np.ndarray:
        operands = [self.values(row) for row in flat]
        if name == "convert":
            return self.constants(scalars.saturating(operands[0], DTYPES[kind]))
        if name == "reinterpret":
            return self.constants(operands[0].view(DTYPES[kind]))
        return self.constants(scalars.fold(name, operands))

    def _simplified(self, name: str, kind: int, flat: np.ndarray) -> np.ndarray:
        """Nodes that say the same; what no rule knows becomes nodes of the operation."""
        if name in COMMUTATIVE:
            flat = np.sort(flat, 0)
        rule = getattr(self, f"_simplify_{name}", None)
        out = np.full(flat.shape[1], -1, np.int32) if rule is None else rule(*flat)
        rest = np.flatnonzero(out < 0)
        if len(rest):
            out[rest] = self.intern(OPS[name], kind, flat[:, rest])
        return out

    def _equals(self, ids: np.ndarray, value) -> np.ndarray:
        """Which nodes are a constant of this value."""
        return (self.op[ids] == CONST) & (self.number[ids] == value)

    def _choose(self, size: int, *cases) -> np.ndarray:
        """The nodes of the first case that holds; -1 where none does."""
        out = np.full(size, -1, np.int32)
        for where, make in cases:
            where = where & (out < 0)
            if where.any():
                out[where] = make(where)
        return out

    def _has(self, ids: np.ndarray, name: str) -> np.ndarray:
        return self.op[ids] == OPS[name]

    def _is_bool(self, ids: np.ndarray) -> bool:
        return self.type[ids[0]] == BOOL

    def _simplify_add(self, a, b):
        return self._choose(
            len(a),
            (self._equals(a, 0), lambda w: b[w]),
            (self._equals(b, 0), lambda w: a[w]),
            (self._has(b, "neg"), lambda w: self.apply("sub", a[w], self.args[b[w], 0])),
            (self._has(a, "neg"), lambda w: self.apply("sub", b[w], self.args[a[w], 0])),
        )

    def _simplify_sub(self, a, b):
        return self._choose(
            len(a),
            (self._equals(b, 0), lambda w: a[w]),
            (self._equals(a, 0), lambda w: self.apply("neg", b[w])),
            (self._has(b, "neg"), lambda w: self.apply("add", a[w], self.args[b[w], 0])),
        )

    def _simplify_mul(self, a, b):
        vanishes = self.finite_math or DTYPES[self.type[a[0]]].kind != "f"
        zero = lambda w: self.like(a, 0)  # noqa: E731
        return self._choose(
            len(a),
            (self._equals(a, 1), lambda w: b[w]),
            (self._equals(b, 1), lambda w: a[w]),
            (self._equals(a, -1), lambda w: self.apply("neg", b[w])),
            (self._equals(b, -1), lambda w: self.apply("neg", a[w])),
            ((self._equals(a, 0) | self._equals(b, 0)) & vanishes, zero),
        )

    def _simplify_div(self, a, b):
        floats = DTYPES[self.type[a[0]]].kind == "f"
        size = abs(self.number[b])
        known = (self.op[b] == CONST) & (size > 1e-30) & (size < 1e30)
        inverse = lambda w: self.constants(1 / self.values(b[w]))  # noqa: E731
        return self._choose(
            len(a),
            (self._equals(b, 1), lambda w: a[w]),
            (known & floats, lambda w: self.apply("mul", a[w], inverse(w))),
        )

    def _simplify_exp(self, a):
        """`exp(n log x)`, a power as XLA vectorises it, with a small n that is known."""
        out = np.full(len(a), -1, np.int32)
        for i in np.flatnonzero(self._has(a, "mul")):
            n, log = sorted(self.args[a[i], :2], key=lambda node: self.op[node] != CONST)
            power = self.number[n] if self.op[n] == CONST else 0
            if power in SMALL_POWERS and self.op[log] == OPS["log"]:
                x = self.args[log, 0]
                product = functools.reduce(functools.partial(self.apply, "mul"), [x] * int(power))
                negative = self.apply("lt", x, self.like(x, 0))
                out[i] = self.apply("select", negative, self.like(x, np.nan), product)
        return out

    def _simplify_neg(self, a):
        return self._choose(len(a), (self._has(a, "neg"), lambda w: self.args[a[w], 0]))

    def _simplify_not(self, a):
        return self._choose(len(a), (self._has(a, "not"), lambda w: self.args[a[w], 0]))

    def _simplify_abs(self, a):
        return self._choose(len(a), (self._has(a, "abs"), lambda w: a[w]))

    def _simplify_max(self, a, b):
        return self._choose(len(a), (a == b, lambda w: a[w]))

    _simplify_min = _simplify_max

    def _simplify_and(self, a, b):
        logical = self._is_bool(a)
        return self._choose(
            len(a),
            (a == b, lambda w: a[w]),
            (self._equals(a, 1) & logical, lambda w: b[w]),
            (self._equals(b, 1) & logical, lambda w: a[w]),
            (self._equals(a, 0), lambda w: a[w]),
            (self._equals(b, 0), lambda w: b[w]),
        )

    def _simplify_or(self, a, b):
        logical = self._is_bool(a)
        return self._choose(
            len(a),
            (a == b, lambda w: a[w]),
            (self._equals(a, 1) & logical, lambda w: a[w]),
            (self._equals(b, 1) & logical, lambda w: b[w]),
            (self._equals(a, 0), lambda w: b[w]),
            (self._equals(b, 0), lambda w: a[w]),
        )

    def _simplify_select(self, p, a, b):
        inner = self._has(p, "not")
        return self._choose(
            len(a),
            (a == b, lambda w: a[w]),
            (self._equals(p, 1), lambda w: a[w]),
            (self._equals(p, 0), lambda w: b[w]),
            (inner, lambda w: self.apply("select", self.args[p[w], 0], b[w], a[w])),
        )
