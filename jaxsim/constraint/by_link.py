"""Rows that act on links, sorted by link, so that sums over the rows of a link are products."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.dynamics.tree import take
from jaxsim.model.topology import Forest


@struct.dataclass
class RowsByLink:
    """The same rows as a `LinkRows` whose links are static.

    Attributes:
      sides: what each row feels of either of its links.
      coupled: as in `LinkRows`, static.
    """

    sides: tuple["Side", ...]
    coupled: bool = struct.field(pytree_node=False)

    def apply(self, x, a):
        """Relative accelerations, (n, d)."""
        return sum((side.apply(a) for side in self.sides[1:]), self.sides[0].apply(a))

    def pull(self, tree, force):
        """Wrenches on the links only."""
        parts = [side.pull(force) for side in self.sides]
        return None, sum(parts[1:], parts[0])

    def curvature(self, tree, W):
        """`G^T W G` of each side by itself."""
        parts = [side.curvature(W) for side in self.sides]
        return None, sum(parts[1:], parts[0])


@struct.dataclass
class Side:
    """The rows of one side; those of links that never move are left out.

    Attributes:
      G: signed maps from accelerations of links to rows, sorted by link.
      order: where each of them is in the block, static.
      size: number of rows in the block, static.
      runs: (links, rows for each) of successive links, static; none or all of a run have rows.
    """

    G: Float[Array, "m d 6"]
    order: tuple[int, ...] = struct.field(pytree_node=False)
    size: int = struct.field(pytree_node=False)
    runs: tuple[tuple[int, int], ...] = struct.field(pytree_node=False)

    def apply(self, a: Float[Array, "njnt 6"]) -> Float[Array, "n d"]:
        """`G a`, zero for the rows that are left out."""
        d = self.G.shape[1]
        parts = [
            jax.vmap(jnp.matmul)(G.reshape(len(at), -1, 6), at).reshape(-1, d)
            for G, at in zip(self._split(self.G), self._split_links(a), strict=True)
            if G is not None
        ]
        found = _concatenate([*parts, jnp.zeros((1, d), a.dtype)][: len(parts) + self._gaps])
        place = np.full(self.size, len(self.order))
        place[list(self.order)] = np.arange(len(self.order))
        return take(found, place)

    def pull(self, force: Float[Array, "n d"]) -> Float[Array, "njnt 6"]:
        """`G^T f`, summed by link."""
        force = take(force, np.array(self.order, int))
        return self._sums(lambda G, f: f.reshape(-1) @ G.reshape(-1, 6), force, (6,))

    def curvature(self, W: Array) -> Float[Array, "njnt 6 6"]:
        """`G^T W G`, summed by link; W is diagonal, (n, d), or in blocks, (n, d, d)."""
        W = take(W, np.array(self.order, int))

        def one(G, W):
            WG = W @ G if W.ndim == G.ndim else W[..., None] * G
            return G.reshape(-1, 6).T @ WG.reshape(-1, 6)

        return self._sums(one, W, (6, 6))

    def _sums(self, one, x, shape):
        """`one(G, x)` of all rows of a link together."""
        parts = []
        for (n, _), G, part in zip(self.runs, self._split(self.G), self._split(x), strict=True):
            if G is None or part is None:
                parts.append(jnp.zeros((n, *shape), x.dtype))
            else:
                parts.append(jax.vmap(one)(G, part))
        return _concatenate(parts)

    @property
    def _gaps(self) -> bool:
        return len(self.order) < self.size

    def _split(self, x) -> list:
        """The sorted rows of each run, (links, rows, ...); None for a run without rows."""
        stops = np.cumsum([n * k for n, k in self.runs]).tolist()
        return [
            x[stop - n * k : stop].reshape(n, k, *x.shape[1:]) if k else None
            for (n, k), stop in zip(self.runs, stops, strict=True)
        ]

    def _split_links(self, a) -> list:
        stops = np.cumsum([n for n, _ in self.runs]).tolist()
        return [a[stop - n : stop] for (n, _), stop in zip(self.runs, stops, strict=True)]


def make_side(tree: Forest, G: Float[Array, "n d 6"], link: np.ndarray) -> Side:
    """Sorts the rows.

    Args:
      tree: the links; runs end where the walks over the tree cut their arrays.
      G: maps from accelerations of links to rows, signed.
      link: (n,) static link of each row, -1 for what does not move.
    """
    order = np.argsort(link, kind="stable")[(link < 0).sum() :]
    count = np.bincount(link[order], minlength=len(tree))
    cuts = {tree.levels[run.start].nodes.start for run in tree.runs}
    keys = zip(count.tolist(), np.cumsum([i in cuts for i in range(len(tree))]), strict=True)
    runs = [(len(list(same)), k) for (k, _), same in itertools.groupby(keys)]
    return Side(take(G, order), tuple(order.tolist()), len(link), tuple(runs))


def _concatenate(parts):
    return parts[0] if len(parts) == 1 else jnp.concatenate(parts)
