"""Instructions of one piece in LLVM's text: operands from memory, operations, results to memory."""

from typing import TYPE_CHECKING

from jaxsim.lanes.code.schedule import ALL_LANES, Move, Piece
from jaxsim.lanes.program.graph import ADD_AT, CONST, INPUT, LOAD, PACK
from jaxsim.lanes.program.liveness import operands
from jaxsim.lanes.program.scalars import name_of
from jaxsim.lanes.program.types import BOOL, DTYPES, INT32, scalar_name

if TYPE_CHECKING:
    from jaxsim.lanes.code.emit import Emitter


class Body:
    """The instructions of one piece."""

    def __init__(self, emitter: "Emitter", piece: Piece):
        self.e, self.g, self.piece, self.code = emitter, emitter.graph, piece, emitter.code
        self.out: list[str] = []
        self.names: dict[int, str] = {}
        self.bases: dict[int, str] = {}
        self.slots = emitter.schedule.slots
        self.frame, self.array = emitter.pointers.frame, emitter.pointers.array

    def lines(self) -> list[str]:
        """All of them."""
        for node in self.piece.nodes:
            self._node(node)
        if self.piece is self.e.schedule.pieces[-1]:
            home = {n for piece in self.e.schedule.pieces for n in piece.nodes}
            for node in self.e.targets:
                if node not in home:
                    self._store_outputs(node)
        self._moves()
        self._tests()
        return self.out

    def name(self, node: int) -> str:
        """An operand: a constant, a value of this piece, or one from memory."""
        found = self.names.get(node)
        if found is None:
            found = self.names[node] = self._fetch(node)
        return found

    def _fetch(self, node: int) -> str:
        g, kind = self.g, int(self.g.type[node])
        if g.op[node] == CONST:
            dtype = DTYPES[kind]
            return self.code.splat((g.number if dtype.kind == "f" else g.integer)[node], kind)
        if g.op[node] == INPUT:
            return self._input(node)
        return self._load_slot(self.slots[node], kind)

    def _emit(self, text: str) -> str:
        out = self.code.fresh()
        self.out.append(f"  {out} = {text}")
        return out

    def _slot(self, slot: int) -> str:
        return self._emit(f"getelementptr i8, {self.frame} %m, i64 {slot * self.e.slot_bytes}")

    def _memory_type(self, kind: int) -> str:
        """Truth values are stored as whole integers."""
        return self.code.vector(INT32 if kind == BOOL else kind)

    def _load_slot(self, slot: int, kind: int) -> str:
        return self._load_vector(self._slot(slot), kind)

    def _load_vector(self, address: str, kind: int) -> str:
        memory = self._memory_type(kind)
        value = self._emit(f"load {memory}, {self.frame} {address}, align {self._align()}")
        return self._truth(value) if kind == BOOL else value

    def _truth(self, value: str) -> str:
        zero = self.code.splat(0, INT32)
        return self._emit(f"icmp ne {self.code.vector(INT32)} {value}, {zero}")

    def _align(self) -> int:
        return min(64, self.e.slot_bytes)

    def _store_slot(self, slot: int, value: str, kind: int) -> None:
        self._store_vector(self._slot(slot), value, kind)

    def _store_vector(self, address: str, value: str, kind: int) -> None:
        memory = self._memory_type(kind)
        if kind == BOOL:
            value = self._emit(f"sext {self.code.vector(BOOL)} {value} to {memory}")
        place = f"{self.frame} {address}"
        self.out.append(f"  store {memory} {value}, {place}, align {self._align()}")

    def _base(self, k: int) -> str:
        if k not in self.bases:
            address = self._emit(f"getelementptr ptr, {self.frame} %p, i64 {k}")
            self.bases[k] = self._emit(f"load {self.array}, {self.frame} {address}")
        return self.bases[k]

    def _address(self, k: int, element: int, size: int, batched: bool) -> str:
        base = f"{self.array} {self._base(k)}"
        if not batched:
            return self._emit(f"getelementptr i8, {base}, i64 {element * size}")
        row = self._emit(f"mul i64 %n, {element * size}")
        lane = self._emit(f"mul i64 %b, {size}")
        both = self._emit(f"add i64 {row}, {lane}")
        return self._emit(f"getelementptr i8, {base}, i64 {both}")

    def _input(self, node: int) -> str:
        k, element = self.g.args[node, :2].tolist()
        kind, batched = self.e.inputs[k]
        size = DTYPES[kind].itemsize
        address = self._address(k, element, size, batched)
        scalar = "i8" if kind == BOOL else scalar_name(kind)
        if batched:
            vector = scalar if self.e.width == 1 else f"<{self.e.width} x {scalar}>"
            value = self._emit(f"load {vector}, {self.array} {address}, align {size}")
            if kind == BOOL:
                zero = "0" if self.e.width == 1 else "zeroinitializer"
                value = self._emit(f"icmp ne {vector} {value}, {zero}")
            return value
        value = self._emit(f"load {scalar}, {self.array} {address}, align {size}")
        return self._spread(value, scalar, kind)

    def _spread(self, value: str, scalar: str, kind: int) -> str:
        """A number of this type in memory for all lanes."""
        if kind == BOOL:
            value = self._emit(f"icmp ne {scalar} {value}, 0")
        out = self.code.fresh()
        self.out += ["  " + line for line in self.code.spread(out, value, kind)]
        return out

    def _node(self, node: int) -> None:
        g, op = self.g, int(self.g.op[node])
        if op == PACK:
            self._pack(node)
            return
        if op == ADD_AT:
            self._add_at(node)
            return
        if op == LOAD:
            self.names[node] = self._load(node)
        else:
            xs = operands(g, node)
            names = [self.name(x) for x in xs]
            out = self.names[node] = f"%v{node}"
            kinds = [int(g.type[x]) for x in xs]
            lines = self.code.operation(out, name_of(op), kinds, int(g.type[node]), names)
            self.out += ["  " + line for line in lines]
        if node in self.slots:
            self._store_slot(self.slots[node], self.names[node], int(g.type[node]))
        self._store_outputs(node)

    def _store_outputs(self, node: int) -> None:
        kind = int(self.g.type[node])
        for k, element in self.e.targets.get(node, ()):
            size, value = DTYPES[kind].itemsize, self.name(node)
            address = self._address(k, element, size, True)
            vector = self.code.vector(kind)
            if kind == BOOL:
                vector = "i8" if self.e.width == 1 else f"<{self.e.width} x i8>"
                value = self._emit(f"zext {self.code.vector(BOOL)} {value} to {vector}")
            place = f"{self.array} {address}"
            self.out.append(f"  store {vector} {value}, {place}, align {size}")

    def _pack(self, node: int) -> None:
        g = self.g
        elements, kind = g.packs[g.args[node, 0]], int(g.type[node])
        if g.is_const(elements).all():
            return
        for i, element in enumerate(elements.tolist()):
            self._store_slot(self.slots[node] + i, self.name(element), kind)

    def _add_at(self, node: int) -> None:
        g, kind, slot = self.g, int(self.g.type[node]), self.slots[node]
        before, start, number = g.args[node].tolist()
        if before < 0:
            for i in range(int(g.integer[node])):
                self._store_slot(slot + i, self.code.splat(0, kind), kind)
            return
        address = self._uniform_address(slot, start, int(g.integer[node]))
        old, sum_ = self._load_vector(address, kind), self.code.fresh()
        lines = self.code.operation(sum_, "add", [kind, kind], kind, [old, self.name(number)])
        self.out += ["  " + line for line in lines]
        self._store_vector(address, sum_, kind)

    def _load(self, node: int) -> str:
        g, kind = self.g, int(self.g.type[node])
        pack, index, offset = g.args[node].tolist()
        if g.op[pack] == ADD_AT:
            return self._load_slot(self.slots[pack] + offset, kind)
        constant = bool(g.is_const(g.packs[g.args[pack, 0]]).all())
        if g.uniform[index]:
            return self._load_uniform(pack, index, offset, constant, kind)
        width, integers = self.e.width, self.code.vector(INT32)
        places = self._emit(f"add {integers} {self.name(index)}, {self.code.splat(offset, INT32)}")
        size = 4 if kind == BOOL else DTYPES[kind].itemsize
        if constant:
            step, base = size, f"ptr {self.e.table(pack)}"
        else:
            step, base = self.e.slot_bytes, f"{self.frame} {self._slot(self.slots[pack])}"
        scaled = self._emit(f"mul {integers} {places}, {self.code.splat(step, INT32)}")
        if not constant and width > 1:
            lanes = ", ".join(f"i32 {i * size}" for i in range(width))
            scaled = self._emit(f"add {integers} {scaled}, <{lanes}>")
        memory = "i32" if kind == BOOL else scalar_name(kind)
        if width == 1:
            address = self._emit(f"getelementptr i8, {base}, i32 {scaled}")
            value = self._emit(f"load {memory}, {base.rsplit(' ', 1)[0]} {address}, align {size}")
            return self._truth(value) if kind == BOOL else value
        pointers = self._emit(f"getelementptr i8, {base}, {integers} {scaled}")
        vector = self._memory_type(kind)
        suffix = self.code.suffix(INT32 if kind == BOOL else kind)
        name = f"@llvm.masked.gather.{suffix}.v{width}p0"
        pointer_type, mask = f"<{width} x ptr>", f"<{width} x i1>"
        self.code.declared[name] = (
            f"declare {vector} {name}({pointer_type}, i32 immarg, {mask}, {vector})"
        )
        value = self._emit(
            f"call {vector} {name}({pointer_type} {pointers}, i32 {size}, "
            f"{mask} splat (i1 true), {vector} poison)"
        )
        return self._truth(value) if kind == BOOL else value

    def _load_uniform(self, pack: int, index: int, offset: int, constant: bool, kind: int) -> str:
        if not constant:
            return self._load_vector(self._uniform_address(self.slots[pack], index, offset), kind)
        place = self._uniform_place(index, offset)
        scalar = "i32" if kind == BOOL else scalar_name(kind)
        address = self._emit(f"getelementptr {scalar}, ptr {self.e.table(pack)}, i32 {place}")
        value = self._emit(f"load {scalar}, ptr {address}")
        return self._spread(value, scalar, kind)

    def _uniform_place(self, index: int, offset: int) -> str:
        """A place in an array, which all lanes share, as one number."""
        place = self.name(index)
        if self.e.width > 1:
            place = self._emit(f"extractelement {self.code.vector(INT32)} {place}, i32 0")
        return self._emit(f"add i32 {place}, {offset}")

    def _uniform_address(self, slot: int, index: int, offset: int) -> str:
        byte = self._emit(f"mul i32 {self._uniform_place(index, offset)}, {self.e.slot_bytes}")
        return self._emit(f"getelementptr i8, {self.frame} {self._slot(slot)}, i32 {byte}")

    def _mask(self, mask: int) -> str:
        if mask == ALL_LANES:
            return self.code.splat(1, BOOL)
        return self._load_slot(self.slots[mask], BOOL)

    def _moves(self) -> None:
        """What reads a place that another move writes is read first and written last."""
        moves = self.piece.moves
        targets = {self.slots[m.target] for m in moves}
        mask = self._mask(self.piece.mask) if any(m.masked for m in moves) else ""
        reads = [m for m in moves if self.slots.get(m.source) in targets]
        values = [self._moved(m, mask) for m in reads]
        for move in moves:
            if move not in reads:
                self._store_move(move, self._moved(move, mask))
        for move, value in zip(reads, values, strict=True):
            self._store_move(move, value)

    def _kind(self, move: Move) -> int:
        return BOOL if move.target < 0 else int(self.g.type[move.target])

    def _moved(self, move: Move, mask: str) -> str:
        kind = self._kind(move)
        value = self._mask(move.source) if move.target < 0 else self.name(move.source)
        if not move.masked:
            return value
        old = self._load_slot(self.slots[move.target], kind)
        vector, bits = self.code.vector(kind), self.code.vector(BOOL)
        return self._emit(f"select {bits} {mask}, {vector} {value}, {vector} {old}")

    def _store_move(self, move: Move, value: str) -> None:
        self._store_slot(self.slots[move.target], value, self._kind(move))

    def _tests(self) -> None:
        """The answer: one bit for each test, whether it holds in any active lane."""
        answer = "0"
        around = "" if self.piece.uniform or not self.piece.tests else self._around()
        for i, node in enumerate(self.piece.tests):
            value, bit = self.name(node), self.code.fresh()
            bits = self.code.vector(BOOL)
            if not self.piece.uniform:
                value = self._emit(f"and {bits} {value}, {around}")
                self._store_slot(self.slots[self.piece.masks[i]], value, BOOL)
            self.out += ["  " + line for line in self.code.any_lane(bit, value)]
            whole = self._emit(f"zext i1 {bit} to i32")
            shifted = self._emit(f"shl i32 {whole}, {i}")
            answer = self._emit(f"or i32 {answer}, {shifted}")
        self.out.append(f"  ret i32 {answer}")

    def _around(self) -> str:
        return self._mask(self.piece.mask)
