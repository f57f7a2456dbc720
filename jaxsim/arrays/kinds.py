"""One function per kind of element, applied to all elements of a mixed list."""

from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.arrays.indexing import take


def apply_by_kind(kind: np.ndarray, functions: Mapping[int, Callable], *arrays: jax.Array):
    """Results of `functions[kind[i]](arrays[0][i], arrays[1][i], ...)`, stacked over i.

    Args:
      kind: (n,) static integers.
      functions: for each kind that occurs, the function of one element.
      arrays: arrays with a leading axis of length n.
    """
    kind = np.asarray(kind, int)
    parts, order = [], []
    for k in np.unique(kind):
        (ids,) = np.nonzero(kind == k)
        parts.append(jax.vmap(functions[int(k)])(*(take(a, ids) for a in arrays)))
        order.append(ids)
    if not parts:
        return jnp.zeros(0, arrays[0].dtype)
    return take(jnp.concatenate(parts), np.argsort(np.concatenate(order)))
