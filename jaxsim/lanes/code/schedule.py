"""The order of operations: depth first, so that few values are alive, in pieces of bounded size.

The program becomes a list of items: `Piece`s of straight-line code, each one function, and between
them loops and branches with items of their own. A value that another piece uses has a place in
memory, the frame of a group of lanes; such places are shared by values that do not live together.
"""

import dataclasses
import heapq

import numpy as np

from jaxsim.lanes.program.graph import (
    ADD_AT,
    CONST,
    CONTROL,
    INPUT,
    PACK,
    PARAM,
    RESULT,
    Branch,
    Graph,
    Loop,
)
from jaxsim.lanes.program.liveness import live, operands

# Operations of a piece, at most.
PIECE = 1_500
# The mask of a piece that all lanes run; other masks have negative numbers.
ALL_LANES = 0


@dataclasses.dataclass
class Move:
    """A value written to the place of a node, at the end of a piece; only in active lanes."""

    target: int
    source: int
    masked: bool = False


@dataclasses.dataclass
class Piece:
    """Straight-line code.

    Attributes:
      nodes: in order.
      position: among all pieces.
      mask: which lanes it is run for.
      moves: what is written at its end.
      tests: conditions whose "any active lane" it returns, as bits.
      masks: where the tests are stored, for the code that they admit.
      uniform: whether the tests are the same in all lanes, and stored nowhere.
    """

    nodes: list[int]
    position: int
    mask: int = ALL_LANES
    moves: list[Move] = dataclasses.field(default_factory=list)
    tests: list[int] = dataclasses.field(default_factory=list)
    masks: list[int] = dataclasses.field(default_factory=list)
    uniform: bool = False


@dataclasses.dataclass
class Repeat:
    """A loop: the head's items, of which the last tests, then the body's."""

    head: list
    body: list


@dataclasses.dataclass
class Choose:
    """Branches, by the bits that the piece before returns."""

    branches: list[list]


class Schedule:
    """Items, and the places of values.

    Args:
      graph: the program.
      outputs: nodes of the results.
      longest: operations of a piece, at most.

    Attributes:
      items: the program.
      pieces: all pieces in order.
      slots: place of each value that has one, by node; masks have negative numbers.
      size: number of places.
    """

    def __init__(self, graph: Graph, outputs: np.ndarray, longest: int = PIECE):
        self.graph, self.outputs, self.longest = graph, outputs, longest
        self.live = live(graph, outputs)
        self.pieces: list[Piece] = []
        self.loops: list[tuple[int, int]] = []
        self._owner = self._owners()
        self._needs = self._needed()
        self._done = np.zeros(graph.size, bool)
        self._masks = 0
        self._spans: dict[int, list[int]] = {}
        roots = [i for i in dict.fromkeys(outputs.tolist()) if self._here(i, 0)]
        self.items = self._block(0, roots, ALL_LANES)
        self.items.append(self._piece([], ALL_LANES))
        self.slots, self.size = self._places()

    def _here(self, node: int, block: int) -> bool:
        return self.graph.block[node] == block and self.graph.op[node] not in (CONST, INPUT, PARAM)

    def _owners(self) -> dict[int, int]:
        """The node of the loop or branch that each block is part of, bodies of loops excepted."""
        owner = {}
        for control in self.graph.controls:
            blocks = [control.head] if isinstance(control, Loop) else control.blocks
            owner.update({block.index: control.node for block in blocks})
        return owner

    def _needed(self) -> dict[int, list[int]]:
        """For each loop or branch, and each body by its block, what it needs from around."""
        g, needs = self.graph, {}

        def need(node: int, block: int):
            home = int(g.block[node])
            if g.op[node] in (CONST, INPUT, PARAM) or home == block:
                return
            at = g.blocks[block]
            while at.parent is not None:
                key = self._owner.get(at.index, -at.index)
                needs.setdefault(key, {})[node] = None
                if at.parent.index == home:
                    return
                at = at.parent

        for node in np.flatnonzero(self.live).tolist():
            op = g.op[node]
            if op not in (CONST, INPUT, PARAM, CONTROL):
                block = int(g.block[node])
                for a in operands(g, node):
                    need(a, block)
        for control in g.controls:
            if not self.live[control.node]:
                continue
            for node in self._entry(control):
                need(node, int(g.block[control.node]))
            if isinstance(control, Loop):
                for k in self._live_params(control):
                    need(int(control.nexts[k]), control.body.index)
                need(control.proceed, control.head.index)
            else:
                for block, out in zip(control.blocks, control.outs, strict=True):
                    for k in self._live_results(control):
                        need(int(out[k]), block.index)
        return {key: list(found) for key, found in needs.items()}

    def _entry(self, control: Loop | Branch) -> list[int]:
        """What is read where a loop or branch begins."""
        if isinstance(control, Branch):
            return control.which
        return [int(control.inits[k]) for k in self._live_params(control)]

    def _live_params(self, loop: Loop) -> list[int]:
        return [k for k, p in enumerate(loop.params) if self.live[p]]

    def _live_results(self, branch: Branch) -> list[int]:
        first = branch.node + 1
        return [k for k in range(len(branch.outs[0])) if self.live[first + k]]

    def _block(self, block: int, roots: list[int], mask: int) -> list:
        """Items of a block that computes some nodes."""
        g, items, pending = self.graph, [], []
        controls = [c for c in g.controls if self.live[c.node] and int(g.block[c.node]) == block]
        for control in sorted(controls, key=lambda c: c.node):
            for node in [*self._needs.get(control.node, []), *self._entry(control)]:
                if self._here(node, block):
                    self._visit(node, block, pending)
            self._done[control.node] = True
            if isinstance(control, Loop):
                items += self._loop(control, pending, mask)
            else:
                items += self._branch(control, pending, mask)
            pending = []
        for node in roots:
            self._visit(node, block, pending)
        return items + self._pieces(pending, mask)

    def _visit(self, root: int, block: int, out: list[int]) -> None:
        """Append the operands of a node, then itself, where they are not there already."""
        g, done, stack = self.graph, self._done, [(root, False)]
        while stack:
            node, ready = stack.pop()
            if ready:
                out.append(node)
                continue
            if done[node] or not self._here(node, block):
                continue
            done[node] = True
            stack.append((node, True))
            stack.extend((a, False) for a in reversed(operands(g, node)))

    def _pieces(self, nodes: list[int], mask: int) -> list[Piece]:
        """Pieces of even length; results are in place already and no code."""
        nodes = [n for n in nodes if self.graph.op[n] not in (RESULT, CONTROL)]
        count = -(-len(nodes) // self.longest)
        cuts = np.linspace(0, len(nodes), count + 1).astype(int)
        return [self._piece(nodes[a:b], mask) for a, b in zip(cuts, cuts[1:], strict=False)]

    def _piece(self, nodes: list[int], mask: int) -> Piece:
        self.pieces.append(Piece(nodes, len(self.pieces), mask))
        return self.pieces[-1]

    def _last(self, items: list, mask: int) -> Piece:
        """The piece at the end of some items, to which moves and tests may be added."""
        if not items or not isinstance(items[-1], Piece):
            items.append(self._piece([], mask))
        return items[-1]

    def _new_mask(self) -> int:
        self._masks += 1
        return -self._masks

    def _loop(self, loop: Loop, pending: list[int], mask: int) -> list:
        items = self._pieces(pending, mask)
        before = self._last(items, mask)
        carried = self._live_params(loop)
        before.moves += [Move(int(loop.params[k]), int(loop.inits[k])) for k in carried]
        inner = mask if loop.uniform else self._new_mask()
        if inner != mask:
            before.moves.append(Move(inner, mask))
        first = len(self.pieces)
        head_roots = [loop.proceed, *self._needs.get(-loop.body.index, [])]
        head = self._block(
            loop.head.index, [n for n in head_roots if self._here(n, loop.head.index)], inner
        )
        test = self._last(head, inner)
        test.tests, test.uniform = [loop.proceed], loop.uniform
        test.masks = [] if loop.uniform else [inner]
        nexts = [int(loop.nexts[k]) for k in carried]
        body = self._block(
            loop.body.index, [n for n in nexts if self._here(n, loop.body.index)], inner
        )
        end = self._last(body, inner)
        end.moves += [
            Move(int(loop.params[k]), n, not loop.uniform)
            for k, n in zip(carried, nexts, strict=True)
            if n != loop.params[k]
        ]
        last = len(self.pieces) - 1
        self.loops.append((first, last))
        for k in carried:
            self._spans[int(loop.params[k])] = [before.position, last]
        if inner != mask:
            self._spans[inner] = [before.position, last]
        return [*items, Repeat(head, body)]

    def _branch(self, branch: Branch, pending: list[int], mask: int) -> list:
        items = self._pieces(pending, mask)
        before = self._last(items, mask)
        uniform = bool(self.graph.uniform[branch.which].all())
        before.tests, before.uniform = list(branch.which), uniform
        inner = [mask if uniform else self._new_mask() for _ in branch.which]
        before.masks = [] if uniform else inner
        needed, bodies = self._live_results(branch), []
        for block, out, own in zip(branch.blocks, branch.outs, inner, strict=True):
            outs = [int(out[k]) for k in needed]
            body = self._block(block.index, [n for n in outs if self._here(n, block.index)], own)
            self._last(body, own).moves += [
                Move(branch.node + 1 + k, n, not uniform) for k, n in zip(needed, outs, strict=True)
            ]
            bodies.append(body)
        last = len(self.pieces) - 1
        for k in needed:
            self._spans[branch.node + 1 + k] = [before.position, last]
        for own in set(inner) - {mask}:
            self._spans[own] = [before.position, last]
        return [*items, Choose(bodies)]

    def _places(self) -> tuple[dict[int, int], int]:
        """Places for what lives beyond its piece; loops keep alive what they read."""
        spans, alias = self._lifetimes()
        free: dict[int, list[int]] = {}
        ends: list[tuple[int, int, int]] = []
        slots, size = {}, 0
        for node, (first, last) in sorted(spans.items(), key=lambda item: item[1][0]):
            while ends and ends[0][0] < first:
                _, slot, length = heapq.heappop(ends)
                heapq.heappush(free.setdefault(length, []), slot)
            length = self._length(node)
            if free.get(length):
                slot = heapq.heappop(free[length])
            else:
                slot, size = size, size + length
            slots[node] = slot
            heapq.heappush(ends, (last, slot, length))
        slots.update({result: slots[param] for result, param in alias.items()})
        return slots, size

    def _length(self, node: int) -> int:
        """Places that a node takes; an array takes one for each element."""
        g = self.graph
        if node >= 0 and g.op[node] == PACK:
            return len(g.packs[g.args[node, 0]])
        return int(g.integer[node]) if node >= 0 and g.op[node] == ADD_AT else 1

    def _lifetimes(self) -> tuple[dict[int, list[int]], dict[int, int]]:
        g, spans = self.graph, {node: list(span) for node, span in self._spans.items()}
        alias = {
            c.node + 1 + k: int(c.params[k])
            for c in g.controls
            if isinstance(c, Loop) and self.live[c.node]
            for k in self._live_params(c)
        }
        home = {n: piece.position for piece in self.pieces for n in piece.nodes}
        for n in home:  # Sums follow each other in one array, that of the first.
            if g.op[n] == ADD_AT and g.args[n, 0] >= 0:
                before = int(g.args[n, 0])
                alias[n] = alias.get(before, before)

        def use(node: int, position: int):
            node = alias.get(node, node)
            if node >= 0 and g.op[node] in (CONST, INPUT):
                return
            first = spans[node][0] if node in spans else home[node]
            if position == first and node not in spans and g.op[node] not in (PACK, ADD_AT):
                return
            for start, end in self.loops:
                if start <= position <= end and not start <= first <= end:
                    position = max(position, end)
            span = spans.setdefault(node, [first, position])
            span[1] = max(span[1], position)

        for piece in self.pieces:
            for node in piece.nodes:
                if g.op[node] in (PACK, ADD_AT):
                    use(node, piece.position)
                for a in operands(g, node):
                    use(a, piece.position)
            for node in [*piece.tests, *[m.source for m in piece.moves if m.target >= 0]]:
                use(node, piece.position)
        for node in self.outputs.tolist():
            if node not in home:
                use(node, len(self.pieces) - 1)
        return spans, alias
