"""A function for each kind of element, mapped over a list of elements of several kinds."""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.arrays.indexing import take


@dataclasses.dataclass(frozen=True)
class Rows:
    """The rows of an array that belong to each of n elements; an element has zero or more rows.

    Attributes:
      x: the array.
      start: (n,) first row of each element, static.
      size: (n,) number of consecutive rows of each, equal for elements of one kind, static.
    """

    x: jax.Array
    start: np.ndarray
    size: np.ndarray

    def blocks(self, ids: np.ndarray | slice = slice(None)) -> jax.Array:
        """(m, size, ...) rows of m > 0 elements of one kind."""
        index = self.start[ids][:, None] + np.arange(int(self.size[ids][0]))
        return take(self.x, index.ravel()).reshape(*index.shape, *self.x.shape[1:])


def apply_by_kind(
    kind: np.ndarray,
    functions: Mapping[int, Callable],
    *inputs: jax.Array | Rows,
    empty: Any,
    start: np.ndarray | None = None,
) -> Any:
    """`functions[kind[i]](inputs[0][i], inputs[1][i], ...)` for all i, by one `vmap` for each kind.

    Args:
      kind: (n,) static integers.
      functions: the function of one element, for each kind that occurs.
      inputs: arrays with a leading axis of length n, or `Rows`.
      empty: the result for n = 0.
      start: (n,) first row of each element in the result, for functions that return several rows.
        The rows of all elements fill the result without gaps. None: results are stacked.

    Returns:
      A pytree of arrays: the results stacked over i, or their rows in order.
    """
    kind = np.asarray(kind, int)
    parts, places = [], []
    for k in np.unique(kind):
        (ids,) = np.nonzero(kind == k)
        each = (x.blocks(ids) if isinstance(x, Rows) else take(x, ids) for x in inputs)
        part = jax.vmap(functions[int(k)])(*each)
        if start is not None:
            ids = (start[ids][:, None] + np.arange(part.shape[1])).ravel()
            part = part.reshape(-1, *part.shape[2:])
        parts.append(part)
        places.append(ids)
    if not parts:
        return jax.tree.map(jnp.asarray, empty)
    order = np.argsort(np.concatenate(places))
    return jax.tree.map(lambda *a: take(jnp.concatenate(a), order), *parts)
