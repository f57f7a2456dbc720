"""LLVM text of a scheduled program: one function for each piece, one for a group of lanes.

A piece gets the frame, the addresses of the arguments and results, the first lane of the group and
the number of lanes. The group's function calls the pieces, with loops and branches between them.
"""

import dataclasses

import numpy as np

from jaxsim.lanes.code.instructions import Instructions
from jaxsim.lanes.code.mathematics import library
from jaxsim.lanes.code.schedule import ALL_LANES, Choose, Move, Piece, Repeat, Schedule
from jaxsim.lanes.program.graph import CONST, INPUT, LOAD, PACK, Graph
from jaxsim.lanes.program.liveness import operands
from jaxsim.lanes.program.scalars import name_of
from jaxsim.lanes.program.types import BOOL, DTYPES, INT32, literal, scalar_name


@dataclasses.dataclass(frozen=True)
class Pointers:
    """LLVM's types of addresses.

    Attributes:
      frame: of the frame and of the table of arguments and results.
      array: of arguments and results.
    """

    frame: str = "ptr"
    array: str = "ptr"

    def arguments(self, attribute: str = "") -> str:
        """Arguments of a group and of a piece."""
        return f"{self.frame}{attribute} %m, {self.frame}{attribute} %p, i64 %b, i64 %n"


CPU = Pointers()


class Emitter:
    """Text of a program.

    Args:
      schedule: the program in order.
      inputs: for each argument its type and whether each lane has its own.
      outputs: nodes of each result.
      width: lanes of a group.
      pointers: types of addresses.
    """

    def __init__(self, schedule: Schedule, inputs, outputs, width: int, pointers=CPU):
        self.schedule, self.graph = schedule, schedule.graph
        self.inputs, self.width, self.pointers = inputs, width, pointers
        self.code = Instructions(width)
        self.lines: list[str] = []
        self._tables: dict[int, str] = {}
        self._globals: list[str] = []
        self._labels = 0
        graph: Graph = self.graph
        wide = any(
            DTYPES[k].itemsize == 8 for k in np.unique(graph.type[: graph.size][schedule.live])
        )
        self.slot_bytes = width * (8 if wide else 4)
        self._targets: dict[int, list[tuple[int, int]]] = {}
        for k, ids in enumerate(outputs):
            for e, node in enumerate(ids.reshape(-1).tolist()):
                self._targets.setdefault(node, []).append((len(inputs) + k, e))

    def module(self) -> str:
        """The whole program; `@group` runs it for `width` lanes."""
        for piece in self.schedule.pieces:
            self._piece(piece)
        body = [f"define internal void @group({self.pointers.arguments()}) {{", "entry:"]
        self._items(self.schedule.items, body)
        body += ["  ret void", "}"]
        functions = library(self.code)
        text = [*self._globals, *self.lines, *body, *functions, *self.code.declared.values()]
        return "\n".join(text)

    @property
    def frame_bytes(self) -> int:
        """Size of the frame of a group."""
        return max(self.schedule.size, 1) * self.slot_bytes

    def _label(self) -> str:
        self._labels += 1
        return f"l{self._labels}"

    def _items(self, items: list, out: list[str]) -> str:
        """Calls and control flow; returns the name of the last piece's answer."""
        answer = ""
        for item in items:
            if isinstance(item, Piece):
                answer = f"%a{item.position}"
                arguments = self.pointers.arguments()
                out.append(f"  {answer} = call i32 @piece{item.position}({arguments})")
            elif isinstance(item, Repeat):
                self._repeat(item, out)
            else:
                self._choose(item, answer, out)
        return answer

    def _repeat(self, item: Repeat, out: list[str]) -> None:
        head, body, end = self._label(), self._label(), self._label()
        out += [f"  br label %{head}", f"{head}:"]
        answer = self._items(item.head, out)
        out += [f"  %c{head} = icmp ne i32 {answer}, 0"]
        out += [f"  br i1 %c{head}, label %{body}, label %{end}", f"{body}:"]
        self._items(item.body, out)
        out += [f"  br label %{head}", f"{end}:"]

    def _choose(self, item: Choose, answer: str, out: list[str]) -> None:
        for i, branch in enumerate(item.branches):
            run, end = self._label(), self._label()
            out += [
                f"  %b{run} = and i32 {answer}, {1 << i}",
                f"  %c{run} = icmp ne i32 %b{run}, 0",
                f"  br i1 %c{run}, label %{run}, label %{end}",
                f"{run}:",
            ]
            self._items(branch, out)
            out += [f"  br label %{end}", f"{end}:"]

    def _piece(self, piece: Piece) -> None:
        body = _Body(self, piece)
        signature = self.pointers.arguments(" noalias")
        self.lines += [
            f"define internal i32 @piece{piece.position}({signature}) noinline {{",
            *body.lines(),
            "}",
        ]

    def table(self, pack: int) -> str:
        """A global array of constants."""
        if pack not in self._tables:
            g, name = self.graph, f"@table{pack}"
            elements = g.packs[g.args[pack, 0]]
            kind = int(g.type[pack])
            scalar = "i32" if kind == BOOL else scalar_name(kind)
            numbers = g.values(elements)
            texts = [literal(v, INT32 if kind == BOOL else kind) for v in numbers]
            content = ", ".join(f"{scalar} {text}" for text in texts)
            self._globals.append(
                f"{name} = internal constant [{len(texts)} x {scalar}] [{content}]"
            )
            self._tables[pack] = name
        return self._tables[pack]


class _Body:
    """The instructions of one piece."""

    def __init__(self, emitter: Emitter, piece: Piece):
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
            for node in self.e._targets:
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
        memory = self._memory_type(kind)
        if kind == BOOL:
            value = self._emit(f"sext {self.code.vector(BOOL)} {value} to {memory}")
        place = f"{self.frame} {self._slot(slot)}"
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
        if kind == BOOL:
            value = self._emit(f"icmp ne i8 {value}, 0")
        out = self.code.fresh()
        self.out += ["  " + line for line in self.code.spread(out, value, kind)]
        return out

    def _node(self, node: int) -> None:
        g, op = self.g, int(self.g.op[node])
        if op == PACK:
            self._pack(node)
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
        for k, element in self.e._targets.get(node, ()):
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

    def _load(self, node: int) -> str:
        g, kind = self.g, int(self.g.type[node])
        pack, index, offset = g.args[node].tolist()
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
        place = self.name(index)
        if self.e.width > 1:
            place = self._emit(f"extractelement {self.code.vector(INT32)} {place}, i32 0")
        place = self._emit(f"add i32 {place}, {offset}")
        if not constant:
            byte = self._emit(f"mul i32 {place}, {self.e.slot_bytes}")
            base = f"{self.frame} {self._slot(self.slots[pack])}"
            return self._load_vector(self._emit(f"getelementptr i8, {base}, i32 {byte}"), kind)
        scalar = "i32" if kind == BOOL else scalar_name(kind)
        address = self._emit(f"getelementptr {scalar}, ptr {self.e.table(pack)}, i32 {place}")
        value = self._emit(f"load {scalar}, ptr {address}")
        if kind == BOOL:
            value = self._emit(f"icmp ne i32 {value}, 0")
        out = self.code.fresh()
        self.out += ["  " + line for line in self.code.spread(out, value, kind)]
        return out

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
