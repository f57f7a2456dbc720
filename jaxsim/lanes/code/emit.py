"""LLVM text of a scheduled program: one function for each piece, one for a group of lanes.

A piece gets the frame, the addresses of the arguments and results, the first lane of the group and
the number of lanes. The group's function calls the pieces, with loops and branches between them.
"""

import dataclasses

import numpy as np

from jaxsim.lanes.code.body import Body
from jaxsim.lanes.code.instructions import Instructions
from jaxsim.lanes.code.mathematics import library
from jaxsim.lanes.code.schedule import Choose, Piece, Repeat, Schedule
from jaxsim.lanes.program.graph import Graph
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
        self.targets: dict[int, list[tuple[int, int]]] = {}
        for k, ids in enumerate(outputs):
            for e, node in enumerate(ids.reshape(-1).tolist()):
                self.targets.setdefault(node, []).append((len(inputs) + k, e))

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
    def operations(self) -> int:
        """How many there are in all pieces."""
        return sum(len(piece.nodes) for piece in self.schedule.pieces)

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
        body = Body(self, piece)
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
