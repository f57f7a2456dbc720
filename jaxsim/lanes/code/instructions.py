"""LLVM instructions of scalar operations, for a vector of lanes."""

import functools

from jaxsim.lanes.program.types import BOOL, DTYPES, literal, scalar_name, vector_name

FLOAT = {"add": "fadd", "sub": "fsub", "mul": "fmul", "div": "fdiv", "rem": "frem"}
INTEGER = {
    "add": "add",
    "sub": "sub",
    "mul": "mul",
    "and": "and",
    "or": "or",
    "xor": "xor",
}
INTRINSIC = {
    "abs": "fabs",
    "sqrt": "sqrt",
    "floor": "floor",
    "ceil": "ceil",
    "round_even": "rint",
    "round_away": "round",
}
SHIFT = {"shift_left": "shl", "shift_right_logical": "lshr", "shift_right_arithmetic": "ashr"}


class Instructions:
    """Text of instructions for `width` lanes; what they call is collected in `declared`."""

    def __init__(self, width: int):
        self.width = width
        self.declared: dict[str, str] = {}
        self.library: set[tuple[str, int]] = set()
        self._fresh = 0

    @functools.cache  # noqa: B019
    def vector(self, kind: int) -> str:
        """LLVM's name of the type."""
        return vector_name(scalar_name(kind), self.width)

    def splat(self, value, kind: int) -> str:
        """A constant in all lanes."""
        text = literal(value, kind)
        return text if self.width == 1 else f"splat ({scalar_name(kind)} {text})"

    def fresh(self) -> str:
        """A new name."""
        self._fresh += 1
        return f"%t{self._fresh}"

    def call(self, out: str, name: str, kind: int, operands, result: int | None = None) -> str:
        """A call of an intrinsic, overloaded by the type of its operands."""
        suffix = self.suffix(kind)
        full, vector = f"@llvm.{name}.{suffix}", self.vector(kind)
        self.declared[full] = f"declare {vector} {full}({', '.join([vector] * len(operands))})"
        arguments = ", ".join(f"{vector} {x}" for x in operands)
        return f"{out} = call {vector} {full}({arguments})"

    def suffix(self, kind: int) -> str:
        """A type as it stands in the names of intrinsics."""
        dtype = DTYPES[kind]
        scalar = (
            "i1" if kind == BOOL else f"{'f' if dtype.kind == 'f' else 'i'}{8 * dtype.itemsize}"
        )
        return scalar if self.width == 1 else f"v{self.width}{scalar}"

    def operation(self, out: str, name: str, kinds, result: int, xs) -> list[str]:
        """Lines that compute `out`.

        Args:
          out: name of the result.
          name: the operation.
          kinds: types of the operands.
          result: type of the result.
          xs: the operands.
        """
        kind = kinds[-1]
        vector, is_float = self.vector(kind), DTYPES[kind].kind == "f"
        if name == "convert":
            return self._convert(out, kind, result, xs[0])
        if name == "reinterpret":
            return [f"{out} = bitcast {vector} {xs[0]} to {self.vector(result)}"]
        if name == "select":
            condition = f"{self.vector(BOOL)} {xs[0]}"
            return [f"{out} = select {condition}, {vector} {xs[1]}, {vector} {xs[2]}"]
        if name in ("lt", "le", "gt", "ge", "eq", "ne"):
            return [f"{out} = {self._comparison(name, kind)} {vector} {xs[0]}, {xs[1]}"]
        if name == "any":
            return self._any(out, xs[0])
        if is_float:
            return self._float(out, name, kind, xs)
        return self._integer(out, name, kind, xs)

    def _comparison(self, name: str, kind: int) -> str:
        if DTYPES[kind].kind == "f":
            return f"fcmp {'une' if name == 'ne' else 'o' + name}"
        if name in ("eq", "ne"):
            return f"icmp {name}"
        return f"icmp {'s' if DTYPES[kind].kind == 'i' else 'u'}{name}"

    def any_lane(self, out: str, x: str) -> list[str]:
        """One bit: whether a truth value holds in any lane."""
        if self.width == 1:
            return [f"{out} = or i1 {x}, false"]
        name, vector = f"@llvm.vector.reduce.or.v{self.width}i1", self.vector(BOOL)
        self.declared[name] = f"declare i1 {name}({vector})"
        return [f"{out} = call i1 {name}({vector} {x})"]

    def spread(self, out: str, scalar: str, kind: int) -> list[str]:
        """One number in all lanes."""
        name, vector = scalar_name(kind), self.vector(kind)
        if self.width == 1:
            return [f"{out} = select i1 true, {name} {scalar}, {name} {scalar}"]
        first = self.fresh()
        return [
            f"{first} = insertelement {vector} poison, {name} {scalar}, i32 0",
            f"{out} = shufflevector {vector} {first}, {vector} poison, "
            f"<{self.width} x i32> zeroinitializer",
        ]

    def _any(self, out: str, x: str) -> list[str]:
        bit = self.fresh()
        return [*self.any_lane(bit, x), *self.spread(out, bit, BOOL)]

    def _float(self, out: str, name: str, kind: int, xs) -> list[str]:
        vector = self.vector(kind)
        if name in FLOAT:
            return [f"{out} = {FLOAT[name]} contract {vector} {xs[0]}, {xs[1]}"]
        if name == "neg":
            return [f"{out} = fneg {vector} {xs[0]}"]
        if name in INTRINSIC:
            return [self.call(out, INTRINSIC[name], kind, xs)]
        if name in ("max", "min"):
            return self._extremum(out, name, kind, xs)
        self.library.add((name, kind))
        arguments = ", ".join(f"{vector} {x}" for x in xs)
        return [f"{out} = call {vector} @{name}_{self.suffix(kind)}({arguments})"]

    def _extremum(self, out: str, name: str, kind: int, xs) -> list[str]:
        """The comparison gives the second operand where one is NaN; a NaN first is put back."""
        vector, bits = self.vector(kind), self.vector(BOOL)
        first, second = xs if not xs[1].startswith(("splat", "0x")) else (xs[1], xs[0])
        relation, known = "ogt" if name == "max" else "olt", first.startswith(("splat", "0x"))
        larger, chosen, nan = self.fresh(), out if known else self.fresh(), self.fresh()
        lines = [
            f"{larger} = fcmp {relation} {vector} {first}, {second}",
            f"{chosen} = select {bits} {larger}, {vector} {first}, {vector} {second}",
        ]
        if not known:
            lines += [
                f"{nan} = fcmp uno {vector} {first}, {first}",
                f"{out} = select {bits} {nan}, {vector} {first}, {vector} {chosen}",
            ]
        return lines

    def _integer(self, out: str, name: str, kind: int, xs) -> list[str]:
        vector, signed = self.vector(kind), DTYPES[kind].kind == "i"
        if name in INTEGER:
            return [f"{out} = {INTEGER[name]} {vector} {xs[0]}, {xs[1]}"]
        if name == "neg":
            return (
                [f"{out} = sub {vector} zeroinitializer, {xs[0]}"]
                if self.width > 1
                else [f"{out} = sub {vector} 0, {xs[0]}"]
            )
        if name == "not":
            ones = self.splat(1 if kind == BOOL else -1, kind)
            return [f"{out} = xor {vector} {xs[0]}, {ones}"]
        if name in ("max", "min"):
            return [self.call(out, ("s" if signed else "u") + name, kind, xs)]
        if name == "population_count":
            return [self.call(out, "ctpop", kind, xs)]
        if name == "clz":
            return [self._leading_zeros(out, kind, xs[0])]
        if name == "abs":
            negative, opposite = self.fresh(), self.fresh()
            zero = self.splat(0, kind)
            return [
                f"{negative} = icmp slt {vector} {xs[0]}, {zero}",
                f"{opposite} = sub {vector} {zero}, {xs[0]}",
                f"{out} = select {self.vector(BOOL)} {negative}, {vector} {opposite}, "
                f"{vector} {xs[0]}",
            ]
        if name in SHIFT:
            return self._shift(out, name, kind, xs)
        return self._quotient(out, name, kind, xs)

    def _leading_zeros(self, out: str, kind: int, x: str) -> str:
        """The second operand says that zero has all of them, and is no undefined case."""
        vector, full = self.vector(kind), f"@llvm.ctlz.{self.suffix(kind)}"
        self.declared[full] = f"declare {vector} {full}({vector}, i1 immarg)"
        return f"{out} = call {vector} {full}({vector} {x}, i1 false)"

    def _shift(self, out: str, name: str, kind: int, xs) -> list[str]:
        """A shift by too much gives zero, or the sign."""
        vector, bits = self.vector(kind), 8 * DTYPES[kind].itemsize
        inside, safe, shifted = self.fresh(), self.fresh(), self.fresh()
        last = self.splat(bits - 1, kind)
        lines = [
            f"{inside} = icmp ule {vector} {xs[1]}, {last}",
            f"{safe} = select {self.vector(BOOL)} {inside}, {vector} {xs[1]}, {vector} {last}",
        ]
        if name == "shift_right_arithmetic":
            return [*lines, f"{out} = ashr {vector} {xs[0]}, {safe}"]
        zero = self.splat(0, kind)
        return [
            *lines,
            f"{shifted} = {SHIFT[name]} {vector} {xs[0]}, {safe}",
            f"{out} = select {self.vector(BOOL)} {inside}, {vector} {shifted}, {vector} {zero}",
        ]

    def _quotient(self, out: str, name: str, kind: int, xs) -> list[str]:
        """Division by zero gives -1 and the dividend; by -1 the opposite, which may overflow."""
        vector, bits = self.vector(kind), self.vector(BOOL)
        prefix = "s" if DTYPES[kind].kind == "i" else "u"
        zero, one, minus = (self.splat(v, kind) for v in (0, 1, -1))
        is_zero, is_minus, unsafe, safe, q, p, first = (self.fresh() for _ in range(7))
        lines = [
            f"{is_zero} = icmp eq {vector} {xs[1]}, {zero}",
            f"{is_minus} = icmp eq {vector} {xs[1]}, {minus}",
            f"{unsafe} = or {bits} {is_zero}, {is_minus}",
            f"{safe} = select {bits} {unsafe}, {vector} {one}, {vector} {xs[1]}",
            f"{q} = {prefix}{name} {vector} {xs[0]}, {safe}",
        ]
        if prefix == "u":
            lines[2] = f"{unsafe} = or {bits} {is_zero}, {is_zero}"
            lines.append(f"{first} = add {vector} {q}, {zero}")
        elif name == "div":
            lines.append(f"{p} = sub {vector} {zero}, {xs[0]}")
            lines.append(f"{first} = select {bits} {is_minus}, {vector} {p}, {vector} {q}")
        else:
            lines.append(f"{first} = select {bits} {is_minus}, {vector} {zero}, {vector} {q}")
        otherwise = minus if name == "div" else xs[0]
        return [*lines, f"{out} = select {bits} {is_zero}, {vector} {otherwise}, {vector} {first}"]

    def _convert(self, out: str, kind: int, result: int, x: str) -> list[str]:
        source, target = DTYPES[kind], DTYPES[result]
        cast = f"{self.vector(kind)} {x} to {self.vector(result)}"
        if target.kind == "f":
            if source.kind == "f":
                return [
                    f"{out} = {'fpext' if target.itemsize > source.itemsize else 'fptrunc'} {cast}"
                ]
            return [f"{out} = {'si' if source.kind == 'i' else 'ui'}tofp {cast}"]
        if source.kind == "f":
            name = f"fpto{'s' if target.kind == 'i' else 'u'}i.sat"
            full = f"@llvm.{name}.{self.suffix(result)}.{self.suffix(kind)}"
            declared = f"declare {self.vector(result)} {full}({self.vector(kind)})"
            self.declared[full] = declared
            return [f"{out} = call {self.vector(result)} {full}({self.vector(kind)} {x})"]
        if target.itemsize == source.itemsize and kind != BOOL:
            return [f"{out} = or {self.vector(kind)} {x}, {x}"]
        if target.itemsize < source.itemsize:
            return [f"{out} = trunc {cast}"]
        return [f"{out} = {'sext' if source.kind == 'i' else 'zext'} {cast}"]
