"""The two recursions over a tree, from which all algorithms of the dynamics are built.

`outward` runs from the roots to the leaves, `inward` from the leaves to the roots. Both take the
recurrence of a single node and evaluate it for all nodes of a level at once. Long runs of equal
levels become one `lax.scan`, so that the size of the program does not grow with depth. Arrays over
nodes or over degrees of freedom are in tree order.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from jaxsim.arrays import tuning
from jaxsim.arrays.indexing import sum_by, take
from jaxsim.model.topology import Forest, Level, Run


def outward(forest: Forest, f: Callable, root: Any, nodes: Any, dofs: Any = ()) -> tuple[Any, Any]:
    """Recur from the roots outward: `y_i, z_i = f(y_parent(i), node_i, dofs_i)`.

    Args:
      forest: the tree, static.
      f: recurrence of one node; `dofs_i` has a leading axis of the node's degrees of freedom, and
        so has its result `z_i`, which may be `()`.
      root: the value of `y_parent` for the roots, stacked over the roots.
      nodes: pytree of arrays over the nodes.
      dofs: pytree of arrays over the degrees of freedom.

    Returns:
      `y` stacked over the nodes and `z` stacked over the degrees of freedom.
    """
    if not len(forest):
        return _empty(forest, f, root, nodes, dofs)
    ys, zs, carry = [], [], root
    for run in forest.runs:
        level = forest.levels[run.start]

        def recur(y, node, dof, level=level):
            return _level(level, f, _take(y, level.parents), node, dof)

        onward = lambda y: y  # noqa: E731
        carry, y, z = _walk(forest, run, recur, onward, carry, nodes, dofs, reverse=False)
        ys.append(y)
        zs.append(z)
    return _concatenate(ys), _concatenate(zs)


def inward(forest: Forest, f: Callable, zero: Any, nodes: Any, dofs: Any = ()) -> tuple[Any, Any]:
    """Recur from the leaves inward: `m_i, z_i = f(sum of m over children of i, node_i, dofs_i)`.

    Args:
      forest: the tree, static.
      f: recurrence of one node; `dofs_i` and `z_i` as in `outward`.
      zero: the sum over no children, for one node.
      nodes: pytree of arrays over the nodes.
      dofs: pytree of arrays over the degrees of freedom.

    Returns:
      `m` stacked over the nodes and `z` stacked over the degrees of freedom.
    """
    if not len(forest):
        return _empty(forest, f, _stack_zero(zero, 0), nodes, dofs)
    ms, zs = [], []
    carry = _stack_zero(zero, forest.levels[-1].size)
    for run in reversed(forest.runs):
        level = forest.levels[run.start]
        above = forest.levels[run.start - 1].size if run.start else forest.nroot

        def recur(total, node, dof, level=level):
            return _level(level, f, total, node, dof)

        def onward(m, level=level, above=above):
            return jax.tree.map(lambda a: sum_by(a, level.parents, above), m)

        carry, m, z = _walk(forest, run, recur, onward, carry, nodes, dofs, reverse=True)
        ms.append(m)
        zs.append(z)
    return _concatenate(ms[::-1]), _concatenate(zs[::-1])


def accumulate_outward(forest: Forest, x: Any) -> Any:
    """Running sums from the roots: `y_i = y_parent(i) + x_i`."""
    if _sums_at_once(forest):
        return _products(forest.ancestor, x)
    zero = jax.tree.map(lambda a: jnp.zeros((forest.nroot, *a.shape[1:]), a.dtype), x)
    return outward(forest, lambda y, x, _: (jax.tree.map(jnp.add, y, x), ()), zero, x)[0]


def accumulate_inward(forest: Forest, x: Any) -> Any:
    """Sums over subtrees: `y_i = x_i + sum of y over the children of i`."""
    if _sums_at_once(forest):
        return _products(forest.ancestor.T, x)
    zero = jax.tree.map(lambda a: jnp.zeros(a.shape[1:], a.dtype), x)
    return inward(forest, lambda y, x, _: (jax.tree.map(jnp.add, y, x), ()), zero, x)[0]


def _sums_at_once(forest: Forest) -> bool:
    """Whether all running sums are faster as one product with a matrix than level by level."""
    return 0 < len(forest) <= tuning.PRODUCT_NODES and len(forest.levels) > 2


def _products(matrix: np.ndarray, x: Any) -> Any:
    return jax.tree.map(lambda a: jnp.tensordot(matrix.astype(a.dtype), a, 1), x)


def _level(level: Level, f, parents, nodes, dofs):
    """Run the recurrence for one level, kind by kind."""
    ys, zs = [], []
    for g in level.groups:
        n = g.nodes.stop - g.nodes.start
        cut = lambda tree, s=g.nodes: jax.tree.map(lambda a: a[s], tree)  # noqa: E731
        block = jax.tree.map(lambda a, g=g, n=n: a[g.dofs].reshape(n, g.ndof, *a.shape[1:]), dofs)
        y, z = jax.vmap(f)(cut(parents), cut(nodes), block)
        ys.append(y)
        zs.append(jax.tree.map(lambda a: a.reshape(-1, *a.shape[2:]), z))
    return _concatenate(ys), _concatenate(zs)


def _walk(forest: Forest, run: Run, recur, onward, carry, nodes, dofs, reverse: bool):
    """Evaluate one run: a single level directly, several levels by a scan.

    `recur` evaluates a level, and `onward` maps its result to the carry of the next level.
    """
    first, last = forest.levels[run.start], forest.levels[run.stop - 1]
    count, size, ndof = run.stop - run.start, first.size, first.ndof
    nodes = jax.tree.map(lambda a: a[first.nodes.start : last.nodes.stop], nodes)
    dofs = jax.tree.map(lambda a: a[first.dofs.start : last.dofs.stop], dofs)
    if count == 1:
        y, z = recur(carry, nodes, dofs)
        y = jax.tree.map(_fusion_barrier, y)
        return onward(y), y, z

    def one(carry, x):
        y, z = recur(carry, _rows(x[0], size), _rows(x[1], ndof))
        return onward(y), (_unrows(y, size), _unrows(z, ndof))

    xs = _split(nodes, count, size), _split(dofs, count, ndof)
    carry, (ys, zs) = lax.scan(one, carry, xs, reverse=reverse)
    return carry, _join(ys, size), _join(zs, ndof)


def _fusion_barrier(y):
    """Stop XLA from recomputing the vectors of a level, and those before it, for each use.

    Matrices need no barrier: they come from products, which XLA does not recompute.
    """
    return lax.optimization_barrier(y) if y.ndim <= 2 else y


# Levels of one row are scanned without the axis of length one. With it, XLA would copy the whole
# array before and after the loop.
def _split(tree, levels: int, size: int):
    return jax.tree.map(lambda a: a if size == 1 else a.reshape(levels, size, *a.shape[1:]), tree)


def _join(tree, size: int):
    return jax.tree.map(lambda a: a if size == 1 else a.reshape(-1, *a.shape[2:]), tree)


def _rows(tree, size: int):
    return jax.tree.map(lambda a: a[None] if size == 1 else a, tree)


def _unrows(tree, size: int):
    return jax.tree.map(lambda a: a[0] if size == 1 else a, tree)


def _take(tree, index):
    return jax.tree.map(lambda a: take(a, index), tree)


def _concatenate(parts):
    if len(parts) == 1:
        return parts[0]
    return jax.tree.map(lambda *a: jnp.concatenate(a), *parts)


def _stack_zero(zero, n: int):
    return jax.tree.map(lambda a: jnp.zeros((n, *jnp.shape(a)), jnp.result_type(a)), zero)


def _empty(forest: Forest, f, parents, nodes, dofs):
    """The empty result of a recursion over a forest without nodes."""
    block = jax.tree.map(lambda a: a.reshape(0, 1, *a.shape[1:]), dofs)
    y, z = jax.vmap(f, axis_size=0)(parents, nodes, block)
    return y, jax.tree.map(lambda a: a.reshape(0, *a.shape[2:]), z)
