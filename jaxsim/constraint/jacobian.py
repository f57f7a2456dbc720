"""Jacobians of constraint rows, in several sparse forms.

`DofRows` are rows of single degrees of freedom, `LinkRows` rows of the relative motion of two links
(those of contacts are in `contact_rows`), and `DenseRows` all others. Products take accelerations
in lifted form: `x` of the degrees of freedom in tree order, and `a` of the links about the trees'
reference points. `a` has six components, or those to which the Jacobian is restricted
(`jaxsim.dynamics.components`). The tree has one link for each joint or, after `renumbered`, for
each body with joints (`jaxsim.model.compound`).
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
from jaxsim.dynamics.free_bodies import in_axes, own_axes
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.velocity import own_twists
from jaxsim.model.compound import Compound
from jaxsim.model.dof_order import to_tree_order
from jaxsim.model.topology import Forest
from jaxsim.solver import weighed


class Jacobian(Protocol):
    """Jacobian J of a block of rows; accelerations of links have c components."""

    def apply(self, x: Float[Array, "nv"], a: Float[Array, "njnt c"]) -> Array:
        """`J x`."""
        ...

    def add_force(self, f: Array, force: Array, wrench: Array) -> tuple[Array, Array]:
        """Add `J^T f` to generalised forces (nv,) and wrenches on the links (njnt, c)."""
        ...

    def add_curvature(self, W: Array, diagonal: Array, matrix: Array) -> tuple[Array, Array]:
        """Add `J^T W J` without coupling to a diagonal (nv,) and link matrices (njnt, c, c).

        Terms that couple two links, or two degrees of freedom of `DenseRows`, are left out.
        """
        ...

    def dense(self, tree: Forest, cdof: Float[Array, "nv c"]) -> Array:
        """J with a last axis of length nv, tree order."""
        ...

    def turned(self, axes: Float[Array, "njnt 3 3"]) -> "Jacobian":
        """The same rows for accelerations of links in axes that are the columns of `axes`."""
        ...

    def restricted(self, components: Components) -> "Jacobian":
        """The same rows for accelerations of links with only these components."""
        ...

    def renumbered(self, compound: Compound) -> "Jacobian":
        """The same rows for the links and the order of a compound tree."""
        ...

    @property
    def coupled(self) -> bool:
        """Whether `add_curvature` leaves terms out."""
        ...


def row_velocity(motion: Motion, jacobian: Jacobian) -> Array:
    """`J qvel` of a block of rows."""
    model, axes = motion.model, own_axes(motion.model, motion.kin)
    jacobian = jacobian if axes is None else jacobian.turned(axes)
    return jacobian.apply(to_tree_order(model, motion.qvel), own_twists(model, motion.vel))


def moves_anything(J: Float[Array, "n nv"]) -> Bool[Array, "n"]:
    """Whether each row is nonzero; a zero row has no inverse inertia and no finite force."""
    return jnp.any(J != 0, axis=1)


@struct.dataclass
class DofRows:
    """Rows `scale * x[dof]` of single degrees of freedom.

    Attributes:
      scale: (n,) factors.
      dof: (n,) degree of freedom of each row, tree order, static.
    """

    scale: Float[Array, "n"]
    dof: tuple[int, ...] = struct.field(pytree_node=False)

    coupled = False

    def apply(self, x, a):
        """`scale * x[dof]`."""
        return self.scale * take(x, np.array(self.dof, int))

    def add_force(self, f, force, wrench):
        """Adds to the generalised forces only."""
        return force + sum_by(self.scale * f, np.array(self.dof, int), len(force)), wrench

    def add_curvature(self, W, diagonal, matrix):
        """Adds to the diagonal; exact."""
        weight = self.scale * self.scale * W
        return diagonal + sum_by(weight, np.array(self.dof, int), len(diagonal)), matrix

    def dense(self, tree, cdof):
        """J with one entry in each row."""
        unit = np.eye(tree.nv)[np.array(self.dof, int)]
        return self.scale[:, None] * jnp.asarray(unit, cdof.dtype)

    def turned(self, axes):
        """No change: the rows do not depend on links."""
        return self

    def restricted(self, components):
        """No change: the rows do not depend on links."""
        return self

    def renumbered(self, compound):
        """The same rows with degrees of freedom renumbered."""
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
        """Adds to the generalised forces only."""
        return force + _flat(self.J).T @ f.reshape(-1), wrench

    def add_curvature(self, W, diagonal, matrix):
        """Adds the diagonal of `J^T W J`."""
        return diagonal + jnp.sum(_flat(weighed(W, self.J) * self.J), axis=0), matrix

    def dense(self, tree, cdof):
        """J itself."""
        return self.J

    def turned(self, axes):
        """No change: the rows do not depend on links."""
        return self

    def restricted(self, components):
        """No change: the rows do not depend on links."""
        return self

    def renumbered(self, compound):
        """The same rows with columns permuted."""
        return DenseRows(jnp.moveaxis(take(jnp.moveaxis(self.J, -1, 0), compound.dof), 0, -1))


@struct.dataclass
class LinkRows:
    """Rows of the motion of one link relative to another, the sum of `G a[link]` over both.

    Attributes:
      sides: for each of the two links, the signed maps G (n, d, c) from accelerations to rows, and
        the link of each row; a side of links that never move is left out.
    """

    sides: tuple[tuple[Float[Array, "n d c"], LinkIndex], ...]

    @property
    def coupled(self):
        """Whether both links of a row may move."""
        return len(self.sides) == 2

    def apply(self, x, a):
        """`J x`, the relative accelerations (n, d)."""
        return self._sum(lambda G, link: jax.vmap(jnp.matmul)(G, gather_or_zero(a, link.index)))

    def add_force(self, f, force, wrench):
        """Adds to the wrenches only."""
        for G, link in self.sides:
            wrench = add_at(wrench, link, jax.vmap(jnp.matmul)(f, G))
        return force, wrench

    def add_curvature(self, W, diagonal, matrix):
        """Adds `G^T W G` of each side; W is diagonal or in blocks (n, d, d)."""
        for G, link in self.sides:
            WG = weighed(W, G)
            matrix = add_at(matrix, link, jax.vmap(lambda G, WG: G.T @ WG)(G, WG))
        return diagonal, matrix

    def dense(self, tree, cdof):
        """J: the maps times the motion axes of the degrees of freedom that move each link."""
        rows = jax.vmap(lambda G, mask: (G @ cdof.T) * mask[None])
        return self._sum(lambda G, link: rows(G, moves(tree, link, cdof.dtype)))

    def turned(self, axes):
        """The same rows with the maps' columns for these axes."""
        turn = jax.vmap(in_axes)
        return LinkRows(tuple((turn(G, link.of_links(axes)), link) for G, link in self.sides))

    def restricted(self, components):
        """The same rows with the maps' columns for these components."""
        return LinkRows(tuple((restrict(components, G), link) for G, link in self.sides))

    def renumbered(self, compound):
        """The same rows with the links renumbered."""
        return LinkRows(tuple((G, link.renumbered(compound.node)) for G, link in self.sides))

    def items(self, index):
        """The rows at these indices."""
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
      H: the matrix to add to.
      J: rows, one item for each contact or row.
      W: diagonal or in blocks, see `jaxsim.solver.weighed`.
      rarely: whether few items have nonzero W. A program for a serial processor then loops over
        those that are nonzero in some environment of the batch.
    """
    if not rarely:
        return _add_all(H, J, W)
    return serial_or_parallel(_add_nonzero, _add_all, H, J, W)


def _add_all(H, J, W):
    return H + _flat(J).T @ _flat(weighed(W, J))


def _add_nonzero(H, J, W):
    nonzero = nonzero_in_batch(W)
    rank = jnp.cumsum(nonzero)

    def add(i, H):
        k = index_of_nth(rank, i)
        rows, weights = (lax.dynamic_index_in_dim(x, k, keepdims=False) for x in (J, W))
        rows, WJ = jnp.atleast_2d(rows, weighed(weights, rows))
        return H + rows.T @ WJ

    return lax.fori_loop(0, jnp.sum(nonzero), add, H)


def _flat(rows: Float[Array, "*rows nv"]) -> Float[Array, "n nv"]:
    """All rows along one axis."""
    return rows.reshape(math.prod(rows.shape[:-1]), rows.shape[-1])


def link_rows(link1: np.ndarray, G1: Array, link2: np.ndarray, G2: Array) -> LinkRows:
    """Rows `G2 a[link2] - G1 a[link1]`, without a side of links that never move.

    Args:
      link1: (n,) first links, -1 for none.
      G1: (n, d, 6) maps from the twists of the first links.
      link2: (n,) second links, -1 for none.
      G2: (n, d, 6) maps from the twists of the second links.
    """
    sides = ((-G1, LinkIndex.of(link1)), (G2, LinkIndex.of(link2)))
    moving = tuple(side for side in sides if side[1].may_move)
    return LinkRows(moving or sides[1:])  # one side is needed for the shape of the rows
