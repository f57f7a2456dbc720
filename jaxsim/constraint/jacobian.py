"""How constraint rows depend on accelerations: three kinds of Jacobian, none of them a matrix.

Rows of single degrees of freedom (`DofRows`), rows of the relative motion of two links
(`LinkRows`), and everything else (`DenseRows`). Accelerations come in lifted form: `x` in tree
order and the accelerations `a` of the links that it causes, about the trees' reference points.
"""

from typing import Protocol

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float, Int

from jaxsim.constraint.by_link import RowsByLink, make_side
from jaxsim.dynamics.tree import sum_by, take
from jaxsim.model.topology import Forest


class Jacobian(Protocol):
    """A block of rows, each in the shape `rows`."""

    def apply(self, x: Float[Array, "nv"], a: Float[Array, "njnt 6"]) -> Array:
        """`J x`."""
        ...

    def pull(self, tree: Forest, force: Array) -> tuple[Array | None, Array | None]:
        """Generalised forces (nv,) and link wrenches (njnt, 6) that add up to `J^T f`."""
        ...

    def curvature(self, tree: Forest, W: Array) -> tuple[Array | None, Array | None]:
        """Diagonal (nv,) and link matrices (njnt, 6, 6) of `J^T W J`, coupling left out."""
        ...

    def dense(self, tree: Forest, cdof: Float[Array, "nv 6"]) -> Array:
        """J with a last axis of length nv, tree order."""
        ...

    def sorted_by_link(self, tree: Forest) -> "Jacobian":
        """The same rows, ready to be pulled and sandwiched many times."""
        ...

    @property
    def coupled(self) -> bool:
        """Whether `curvature` leaves anything out."""
        ...


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

    def pull(self, tree, force):
        """Generalised forces only."""
        return sum_by(self.scale * force, np.array(self.dof, int), tree.nv), None

    def curvature(self, tree, W):
        """A diagonal, and exact."""
        return sum_by(self.scale * self.scale * W, np.array(self.dof, int), tree.nv), None

    def dense(self, tree, cdof):
        """One entry per row."""
        unit = np.eye(tree.nv)[np.array(self.dof, int)]
        return self.scale[:, None] * jnp.asarray(unit, cdof.dtype)

    def sorted_by_link(self, tree):
        """Nothing to sort."""
        return self


@struct.dataclass
class DenseRows:
    """Rows given by a matrix over the degrees of freedom, tree order."""

    J: Float[Array, "n nv"]

    coupled = True

    def apply(self, x, a):
        """`J x`."""
        return self.J @ x

    def pull(self, tree, force):
        """Generalised forces only."""
        return self.J.T @ force, None

    def curvature(self, tree, W):
        """The diagonal of `J^T W J`."""
        return jnp.sum(W[:, None] * self.J * self.J, axis=0), None

    def dense(self, tree, cdof):
        """J itself."""
        return self.J

    def sorted_by_link(self, tree):
        """Nothing to sort."""
        return self


@struct.dataclass
class LinkRows:
    """Rows of the motion of one link relative to another: `G2 a[link2] - G1 a[link1]`.

    Attributes:
      G1: maps the acceleration of the first link to the rows; None if it never moves.
      G2: likewise for the second link.
      link1: (n,) first links in tree order, -1 for what does not move; None if none moves.
        Numpy if static, traced if decided at run time.
      link2: (n,) second links, likewise.
    """

    G1: Float[Array, "n d 6"] | None
    G2: Float[Array, "n d 6"] | None
    link1: "Links | Int[Array, ' n'] | None"
    link2: "Links | Int[Array, ' n'] | None"

    @property
    def coupled(self):
        """Whether two links that both move may meet in one row."""
        return self.G1 is not None and self.G2 is not None

    def apply(self, x, a):
        """Relative accelerations, (n, d)."""
        parts = [sign * _rows(G, _gather(a, link)) for sign, G, link in self._sides()]
        return sum(parts[1:], parts[0])

    def pull(self, tree, force):
        """Wrenches on the links only."""
        wrench = jax.vmap(lambda G, f: f @ G)
        parts = [
            _scatter(sign * wrench(G, force), link, len(tree)) for sign, G, link in self._sides()
        ]
        return None, sum(parts[1:], parts[0])

    def curvature(self, tree, W):
        """`G^T W G` of each side by itself."""
        parts = [_scatter(_sandwich(G, W), link, len(tree)) for _, G, link in self._sides()]
        return None, sum(parts[1:], parts[0])

    def dense(self, tree, cdof):
        """Rows times the motion axes of the degrees of freedom that move each link."""
        parts = [
            sign
            * jax.vmap(lambda G, mask: (G @ cdof.T) * mask[None])(G, _moves(tree, link, cdof.dtype))
            for sign, G, link in self._sides()
        ]
        return sum(parts[1:], parts[0])

    def sorted_by_link(self, tree):
        """Sorted where the links are known; links decided at run time stay as they are."""
        known = [(sign * G, k) for sign, G, k in self._sides() if isinstance(k, Links)]
        if len(known) < len(self._sides()):
            return self
        parts = tuple(make_side(tree, G, links.array) for G, links in known)
        return RowsByLink(parts, self.coupled)

    def _sides(self):
        sides = [(1.0, self.G2, self.link2), (-1.0, self.G1, self.link1)]
        return [(sign, G, link) for sign, G, link in sides if G is not None]


@struct.dataclass
class Links:
    """Static link numbers."""

    index: tuple[int, ...] = struct.field(pytree_node=False)

    @property
    def array(self) -> np.ndarray:
        """The numbers as an array."""
        return np.array(self.index, int)


def link_rows(link1, G1, link2, G2) -> LinkRows:
    """`LinkRows` that leaves out a side which never moves.

    Args:
      link1: (n,) numpy or traced link numbers, -1 for what does not move.
      G1: (n, d, 6).
      link2: like link1.
      G2: (n, d, 6).
    """
    if isinstance(link1, np.ndarray) and isinstance(link2, np.ndarray):
        moves1, moves2 = (link1 >= 0).any(), (link2 >= 0).any()
        if not moves1 and not moves2:
            moves2 = True  # Rows of nothing still need their shape.
        wrap = lambda link: Links(tuple(int(i) for i in link))  # noqa: E731
        return LinkRows(
            G1 if moves1 else None,
            G2 if moves2 else None,
            wrap(link1) if moves1 else None,
            wrap(link2) if moves2 else None,
        )
    return LinkRows(G1, G2, jnp.asarray(link1), jnp.asarray(link2))


def _rows(G, a):
    return jax.vmap(jnp.matmul)(G, a)


def _sandwich(G, W):
    if W.ndim == G.ndim:
        return jax.vmap(lambda G, W: G.T @ (W @ G))(G, W)
    return jax.vmap(lambda G, w: G.T @ (w[:, None] * G))(G, W)


def _gather(a, link):
    """Rows of `a`, zero for link -1."""
    padded = jnp.concatenate([a, jnp.zeros_like(a[:1])])
    if not isinstance(link, Links):
        return padded[link]  # -1 is the row of zeros
    index = link.array
    if (index >= 0).all():
        return take(a, index)
    return take(padded, np.where(index < 0, len(a), index))


def _scatter(x, link, n: int):
    """Sums over the rows of each link; link -1 is dropped."""
    if not isinstance(link, Links):
        return jnp.zeros((n + 1, *x.shape[1:]), x.dtype).at[link].add(x)[:n]
    (moving,) = np.nonzero(link.array >= 0)
    return sum_by(take(x, moving), link.array[moving], n)


def _moves(tree: Forest, link, dtype):
    masks = jnp.asarray(tree.moves, dtype)
    return take(masks, link.array % len(masks)) if isinstance(link, Links) else masks[link]
