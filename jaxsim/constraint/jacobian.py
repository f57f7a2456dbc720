"""How constraint rows depend on accelerations: kinds of Jacobians.

Rows of single degrees of freedom (`DofRows`), rows of the relative motion of two links
(`LinkRows`; those of contacts are in `contact_rows`), and everything else (`DenseRows`).
Accelerations come in lifted form: `x` in tree order and the accelerations `a` of the links that
it causes, about the trees' reference points. Of these there are six components, or those that
the Jacobian was restricted to (`jaxsim.dynamics.components`). The tree has one link for each joint
or, after `renumbered`, for each body with joints (`jaxsim.model.compound`).
"""

import math
from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.indexing import gather_or_zero, sum_by, take
from jaxsim.batching.primitives.decisions import index_of_nth, nonzero_in_batch, serial_or_parallel
from jaxsim.constraint.link_index import LinkIndex, add_at, items, moves
from jaxsim.dynamics.components import Components, restrict
from jaxsim.dynamics.motion import Motion
from jaxsim.model.compound import Compound
from jaxsim.model.dof_order import to_tree_order
from jaxsim.model.topology import Forest
from jaxsim.solver import weighed


class Jacobian(Protocol):
    """A block of rows, each in the shape `rows`; links' motions have c components."""

    def apply(self, x: Float[Array, "nv"], a: Float[Array, "njnt c"]) -> Array:
        """`J x`."""
        ...

    def add_force(self, f: Array, force: Array, wrench: Array) -> tuple[Array, Array]:
        """Generalised forces (nv,) and wrenches on the links (njnt, c), with `J^T f` added."""
        ...

    def add_curvature(self, W: Array, diagonal: Array, matrix: Array) -> tuple[Array, Array]:
        """A diagonal (nv,) and link matrices (njnt, c, c), with `J^T W J` added, uncoupled."""
        ...

    def dense(self, tree: Forest, cdof: Float[Array, "nv c"]) -> Array:
        """J with a last axis of length nv, tree order."""
        ...

    def restricted(self, components: Components) -> "Jacobian":
        """The same rows, for links whose motions have these components."""
        ...

    def renumbered(self, compound: Compound) -> "Jacobian":
        """The same rows, for the links and the order of a compound tree."""
        ...

    @property
    def coupled(self) -> bool:
        """Whether `add_curvature` leaves anything out."""
        ...


def row_velocity(motion: Motion, jacobian: Jacobian) -> Array:
    """`J qvel` of a block of rows."""
    return jacobian.apply(to_tree_order(motion.model, motion.qvel), motion.vel.cvel)


def moves_anything(J: Float[Array, "n nv"]) -> Bool[Array, "n"]:
    """Which rows are not zero. What moves nothing has no inertia either, and no finite force."""
    return jnp.any(J != 0, axis=1)


@struct.dataclass
class DofRows:
    """Rows that are multiples of single degrees of freedom: `scale * x[dof]`.

    Attributes:
      scale: (n,) multiples.
      dof: (n,) degree of freedom of each row, tree order, static.
    """

    scale: Float[Array, "n"]
    dof: tuple[int, ...] = struct.field(pytree_node=False)

    coupled = False

    def apply(self, x, a):
        """`scale * x[dof]`."""
        return self.scale * take(x, np.array(self.dof, int))

    def add_force(self, f, force, wrench):
        """Generalised forces only."""
        return force + sum_by(self.scale * f, np.array(self.dof, int), len(force)), wrench

    def add_curvature(self, W, diagonal, matrix):
        """A diagonal, and exact."""
        weight = self.scale * self.scale * W
        return diagonal + sum_by(weight, np.array(self.dof, int), len(diagonal)), matrix

    def dense(self, tree, cdof):
        """One entry per row."""
        unit = np.eye(tree.nv)[np.array(self.dof, int)]
        return self.scale[:, None] * jnp.asarray(unit, cdof.dtype)

    def restricted(self, components):
        """As it is."""
        return self

    def renumbered(self, compound):
        """Degrees of freedom have other numbers."""
        return DofRows(self.scale, tuple(compound.dof_position[np.array(self.dof, int)].tolist()))


@struct.dataclass
class DenseRows:
    """Rows given by a matrix over the degrees of freedom, tree order."""

    J: Float[Array, "*rows nv"]

    coupled = True

    def apply(self, x, a):
        """`J x`."""
        return self.J @ x

    def add_force(self, f, force, wrench):
        """Generalised forces only."""
        return force + _flat(self.J).T @ f.reshape(-1), wrench

    def add_curvature(self, W, diagonal, matrix):
        """The diagonal of `J^T W J`."""
        return diagonal + jnp.sum(_flat(weighed(W, self.J) * self.J), axis=0), matrix

    def dense(self, tree, cdof):
        """J itself."""
        return self.J

    def restricted(self, components):
        """As it is."""
        return self

    def renumbered(self, compound):
        """Columns change places."""
        return DenseRows(jnp.moveaxis(take(jnp.moveaxis(self.J, -1, 0), compound.dof), 0, -1))


@struct.dataclass
class LinkRows:
    """Rows of the motion of one link relative to another: `sum of G a[link]` over both.

    Attributes:
      sides: signed maps (n, d, c) from accelerations to rows, and the links they belong to;
        links that never move are left out.
    """

    sides: tuple[tuple[Float[Array, "n d c"], LinkIndex], ...]

    @property
    def coupled(self):
        """Whether two links that both move may meet in one row."""
        return len(self.sides) == 2

    def apply(self, x, a):
        """Relative accelerations, (n, d)."""
        return self._sum(lambda G, link: jax.vmap(jnp.matmul)(G, gather_or_zero(a, link.index)))

    def add_force(self, f, force, wrench):
        """Wrenches on the links only."""
        for G, link in self.sides:
            wrench = add_at(wrench, link, jax.vmap(jnp.matmul)(f, G))
        return force, wrench

    def add_curvature(self, W, diagonal, matrix):
        """`G^T W G` of each side by itself; W is diagonal or in blocks (n, d, d)."""
        for G, link in self.sides:
            WG = weighed(W, G)
            matrix = add_at(matrix, link, jax.vmap(lambda G, WG: G.T @ WG)(G, WG))
        return diagonal, matrix

    def dense(self, tree, cdof):
        """Rows times the motion axes of the degrees of freedom that move each link."""
        rows = jax.vmap(lambda G, mask: (G @ cdof.T) * mask[None])
        return self._sum(lambda G, link: rows(G, moves(tree, link, cdof.dtype)))

    def restricted(self, components):
        """Columns of the maps."""
        return LinkRows(tuple((restrict(components, G), link) for G, link in self.sides))

    def renumbered(self, compound):
        """Links have other numbers."""
        return LinkRows(tuple((G, link.renumbered(compound.node)) for G, link in self.sides))

    def items(self, index):
        """Those with an index."""
        sides = tuple((items(G, index), link.items(index)) for G, link in self.sides)
        return LinkRows(sides)

    def _sum(self, f):
        parts = [f(G, link) for G, link in self.sides]
        return sum(parts[1:], parts[0])


def add_products(
    H: Float[Array, "nv nv"], J: Float[Array, "n *d nv"], W: Array, *, rarely: bool
) -> Float[Array, "nv nv"]:
    """`H + J^T W J`.

    Args:
      H: what to add to.
      J: rows, one item for each contact or row.
      W: diagonal or in blocks, see `jaxsim.solver.weighed`.
      rarely: whether few of the items push. A serial program then goes through those alone that do
        anywhere in a batch.
    """
    if not rarely:
        return _add_all(H, J, W)
    return serial_or_parallel(_add_pushing, _add_all, H, J, W)


def _add_all(H, J, W):
    return H + _flat(J).T @ _flat(weighed(W, J))


def _add_pushing(H, J, W):
    pushes = nonzero_in_batch(W)
    rank = jnp.cumsum(pushes)

    def add(i, H):
        k = index_of_nth(rank, i)
        rows, weights = (lax.dynamic_index_in_dim(x, k, keepdims=False) for x in (J, W))
        rows, WJ = jnp.atleast_2d(rows, weighed(weights, rows))
        return H + rows.T @ WJ

    return lax.fori_loop(0, jnp.sum(pushes), add, H)


def _flat(rows: Float[Array, "*rows nv"]) -> Float[Array, "n nv"]:
    """All rows along one axis."""
    return rows.reshape(math.prod(rows.shape[:-1]), rows.shape[-1])


def link_rows(link1: np.ndarray, G1: Array, link2: np.ndarray, G2: Array) -> LinkRows:
    """Rows `G2 a[link2] - G1 a[link1]`, without the links that never move.

    Args:
      link1: (n,) first links, -1 for what does not move.
      G1: (n, d, 6).
      link2: (n,) second links, likewise.
      G2: (n, d, 6).
    """
    sides = ((-G1, LinkIndex.of(link1)), (G2, LinkIndex.of(link2)))
    moving = tuple(side for side in sides if side[1].may_move)
    return LinkRows(moving or sides[1:])  # Rows of nothing still need their shape.
