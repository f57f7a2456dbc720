"""The language of one lane: scalar operations as rows of arrays, in nested blocks.

A node is an index. Its row says the operation, the type, up to three operands and the block where
it stands. A program has some 50,000 of them, so that they are made, folded and shared as whole
arrays; only the table of what exists already is asked for each one.

A block is the root, or part of a loop or of a branch. Operands stand in the same block or in one
around it. A new node is put into the outermost block where its operands are known, which moves
loop-invariant code out of loops; out of a branch nothing is moved.
"""

import dataclasses

import numpy as np

from jaxsim.lanes.program.types import DTYPES, code

CONST, INPUT, PARAM, RESULT, CONTROL, PACK, LOAD, ADD_AT = range(8)
FIRST_OPERATION = 8


@dataclasses.dataclass
class Block:
    """Part of a program.

    Attributes:
      parent: the block around it; None for the root.
      depth: of nesting.
      leaves: the depth that operands must be above, so that a node may leave; None for never.
      target: the block where a node that leaves is put, if it may not leave that one too.
    """

    parent: "Block | None"
    depth: int
    leaves: int | None = None
    target: "Block | None" = None
    index: int = 0


@dataclasses.dataclass
class Loop:
    """Runs `body` while `proceed` holds, in each lane for itself.

    Attributes:
      head: block of the condition; `body` is a block within.
      params: what is carried, as nodes of the head.
      inits: what it is at first.
      proceed: the condition.
      nexts: what is carried on.
      uniform: whether all lanes leave at the same time.
      node: the node of the whole loop in the block around it.
    """

    head: Block
    body: Block
    params: np.ndarray
    inits: np.ndarray
    proceed: int = -1
    nexts: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, np.int32))
    uniform: bool = False
    node: int = -1


@dataclasses.dataclass
class Branch:
    """One of several blocks, by an index for each lane.

    Attributes:
      which: for each block the condition under which a lane takes it.
      blocks: the blocks.
      outs: for each block its results.
      node: the node of the whole in the block around it.
    """

    which: list[int]
    blocks: list[Block]
    outs: list[np.ndarray]
    node: int = -1


class Graph:
    """A program for one lane."""

    def __init__(self):
        self.size = 0
        self.op, self.type, self.depth = (np.zeros(1024, np.int16) for _ in range(3))
        self.block = np.zeros(1024, np.int32)
        self.args = np.full((1024, 3), -1, np.int32)
        self.number, self.integer = np.zeros(1024), np.zeros(1024, np.int64)
        self.uniform = np.zeros(1024, bool)
        self.root = Block(None, 0)
        self.blocks = [self.root]
        self.current = self.root
        self.controls: list[Loop | Branch] = []
        self.packs: list[np.ndarray] = []
        self._table: dict = {}

    def new_block(self, parent: Block, leaves=None, target=None) -> Block:
        """A block within another one."""
        block = Block(parent, parent.depth + 1, leaves, target, len(self.blocks))
        self.blocks.append(block)
        return block

    def constants(self, values) -> np.ndarray:
        """Nodes of constants, the same for the same bits."""
        values = np.asarray(values)
        kind = code(values.dtype)
        flat = np.ascontiguousarray(values).reshape(-1)
        bits = flat.view(f"u{flat.dtype.itemsize}")
        unique, first, inverse = np.unique(bits, return_index=True, return_inverse=True)
        ids = np.empty(len(unique), np.int32)
        for i, (key, at) in enumerate(zip(unique.tolist(), first.tolist(), strict=True)):
            node = self._table.get((CONST, kind, key))
            if node is None:
                node = self._table[CONST, kind, key] = self._append(CONST, kind, self.root, True)
                self.number[node] = flat[at]
                if flat.dtype.kind != "f":
                    self.integer[node] = np.array(flat[at]).astype(np.int64)
            ids[i] = node
        return ids[inverse].reshape(values.shape)

    def is_const(self, ids) -> np.ndarray:
        """Which nodes are constants."""
        return self.op[ids] == CONST

    def values(self, ids, dtype=None) -> np.ndarray:
        """The numbers of constants."""
        ids = np.asarray(ids)
        if dtype is None:
            dtype = DTYPES[self.type[ids.flat[0]]]
        source = self.number if dtype.kind == "f" else self.integer
        return source[ids].astype(dtype)

    def leaf(self, op: int, kind: int, count: int, a=-1, first=0, uniform=False) -> np.ndarray:
        """New nodes in the current block, which are shared with no others."""
        ids = np.array(
            [self._append(op, kind, self.current, uniform) for _ in range(count)], np.int32
        )
        if count:
            self.args[ids, 0] = a
            self.args[ids, 1] = np.arange(first, first + count)
        return ids

    def sums_at(self, starts: np.ndarray, rows: np.ndarray, size: int) -> np.ndarray:
        """An array of zeros in memory, to which rows are added where each starts.

        Each sum is a node that follows the one before, in the current block: it changes the array.

        Args:
          starts: (n,) places, the same in all lanes, within the array.
          rows: (n, k) what is added at each place and the ones after it.
          size: of the array.
        """
        kind = int(self.type[rows[0, 0]])
        last = self._append(ADD_AT, kind, self.current, False)
        self.integer[last] = size
        for start, row in zip(starts.tolist(), rows.tolist(), strict=True):
            for offset, number in enumerate(row):
                node = self._append(ADD_AT, kind, self.current, False)
                self.args[node], self.integer[node] = (last, start, number), offset
                last = node
        zero = int(self.constants(np.int32(0)))
        where = np.stack([np.full(size, last), np.full(size, zero)]).astype(np.int32)
        return self.intern(LOAD, kind, where, np.arange(size))

    def pack(self, elements: np.ndarray) -> int:
        """An array in memory, for an index that is known only at run time."""
        elements = np.asarray(elements, np.int32).reshape(-1)
        block = self._places(elements.reshape(-1, 1))[0]
        key = (PACK, block.index, elements.tobytes())
        if key not in self._table:
            uniform = bool(self.uniform[elements].all())
            node = self._append(PACK, int(self.type[elements[0]]), block, uniform)
            self.args[node, 0] = len(self.packs)
            self.packs.append(elements)
            self._table[key] = node
        return self._table[key]

    def intern(self, op: int, kind: int, operands: np.ndarray, attribute=None) -> np.ndarray:
        """Nodes of an operation on columns of operands (n, count), new or as they exist.

        Args:
          op: the operation.
          kind: type of the results.
          operands: nodes, one row for each operand.
          attribute: integers kept in place of a third operand.
        """
        count = operands.shape[1]
        rows = operands if attribute is None else np.vstack([operands, attribute])
        blocks = self._places(operands)
        ids, table, fresh, first = np.empty(count, np.int32), self._table, [], self.size
        for i, (block, key) in enumerate(
            zip(blocks, zip(*rows.tolist(), strict=True), strict=True)
        ):
            at, node = block, None
            while at is not None and node is None:
                node = table.get((op, kind, at.index, key))
                at = at.parent
            if node is None:
                node = table[op, kind, block.index, key] = first + len(fresh)
                fresh.append(i)
            ids[i] = node
        self._append_all(op, kind, [blocks[i] for i in fresh], rows[:, fresh], operands[:, fresh])
        return ids

    def _append_all(self, op: int, kind: int, blocks: list[Block], rows, operands):
        first, last = self.size, self.size + len(blocks)
        while last > len(self.op):
            self._grow()
        self.size, new = last, slice(first, last)
        self.op[new], self.type[new] = op, kind
        self.block[new] = [block.index for block in blocks]
        self.depth[new] = [block.depth for block in blocks]
        self.args[new, : len(rows)] = rows.T
        self.uniform[new] = self.uniform[operands].all(0)

    def _places(self, operands: np.ndarray) -> list[Block]:
        """The outermost block for each column of operands."""
        depth = self.depth[operands].max(0)
        places = np.full(len(depth), self.current.index)
        block = self.current
        moving = np.ones(len(depth), bool)
        while block.leaves is not None and block.target is not None:
            moving &= depth < block.leaves
            if not moving.any():
                break
            block = block.target
            places[moving] = block.index
        return [self.blocks[i] for i in places.tolist()]

    def _append(self, op: int, kind: int, block: Block, uniform: bool) -> int:
        node = self.size
        if node == len(self.op):
            self._grow()
        self.size += 1
        self.op[node], self.type[node], self.block[node] = op, kind, block.index
        self.depth[node], self.uniform[node] = block.depth, uniform
        return node

    def _grow(self):
        for name in "op type depth block number integer uniform".split():
            old = getattr(self, name)
            setattr(self, name, np.concatenate([old, np.zeros_like(old)]))
        self.args = np.concatenate([self.args, np.full_like(self.args, -1)])
