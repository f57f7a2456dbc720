"""`LinkIndex`: the link of each constraint row, and sums over the rows of each link."""

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, Shaped

from jaxsim.arrays import tuning
from jaxsim.arrays.indexing import Index, gather, sum_by, take
from jaxsim.model.topology import Forest


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class LinkIndex:
    """The link of each row in tree order, -1 for none; static or traced.

    It is traced if contacts are assigned to slots at run time.
    """

    static: tuple[int, ...] | None = dataclasses.field(metadata={"static": True})
    traced: Int[Array, "n"] | None

    @classmethod
    def of(cls, index) -> "LinkIndex":
        """The links in an array; static if it is a NumPy array."""
        if isinstance(index, np.ndarray):
            return cls(tuple(int(i) for i in index), None)
        return cls(None, jnp.asarray(index))

    @property
    def index(self) -> Index:
        """The links as an array; a NumPy array if they are static."""
        return np.array(self.static, int) if self.traced is None else self.traced

    def renumbered(self, node: np.ndarray) -> "LinkIndex":
        """The links after renumbering link i to `node[i]`; `node[-1]` must be -1."""
        return LinkIndex.of(gather(node, self.index))

    def items(self, index: Int[Array, "k"]) -> "LinkIndex":
        """The links of the rows at these indices, traced."""
        return LinkIndex(None, items(jnp.asarray(self.index), index))

    def of_links(self, x: Shaped[Array, "njnt ..."]) -> Shaped[Array, "n ..."]:
        """The entry of each row's link; arbitrary where it is -1."""
        return gather(x, self.index % len(x))

    @property
    def may_move(self) -> bool:
        """Whether some row may have a link; False only if that is known not to be so."""
        return self.static is None or any(i >= 0 for i in self.static)


def items(x: Shaped[Array, "n ..."], index: Int[Array, "k"]) -> Shaped[Array, "k ..."]:
    """`x[index]`, with indices clipped to the last item."""
    return jnp.take(x, index, axis=0, mode="clip")


def add_at(total: Float[Array, "njnt ..."], links: LinkIndex, x, form: Callable = lambda x: x):
    """`total` plus `form(x)` of each row at its link; rows without a link are dropped.

    Args:
      total: one entry for each link.
      links: link of each row.
      x: pytree of rows.
      form: linear function from a row, or a sum of rows, to an entry of `total`.
    """
    if links.traced is not None:
        if links.traced.size * len(total) <= tuning.ONE_HOT_PAIRS:
            one_hot = (links.traced[:, None] == jnp.arange(len(total))[None]).astype(total.dtype)
            sums = jax.tree.map(lambda a: jnp.einsum("nl,n...->l...", one_hot, a), x)
            return total + jax.vmap(form)(sums)
        index = jnp.where(links.traced < 0, len(total), links.traced)
        return total.at[index].add(jax.vmap(form)(x), mode="drop")
    index = np.array(links.static, int)
    (moving,) = np.nonzero(index >= 0)
    touched, group = np.unique(index[moving], return_inverse=True)
    sums = jax.tree.map(lambda a: sum_by(take(a, moving), group, len(touched)), x)
    changed = take(total, touched) + jax.vmap(form)(sums)
    # Entries of links without rows are copied, not added to.
    source = np.arange(len(total))
    source[touched] = len(total) + np.arange(len(touched))
    return take(jnp.concatenate([total, changed]), source)


def moves(tree: Forest, links: LinkIndex, dtype) -> Float[Array, "n nv"]:
    """Matrix that is 1 where a degree of freedom moves the link of a row, else 0."""
    return jnp.asarray(gather(tree.moves.astype(dtype), links.index))
