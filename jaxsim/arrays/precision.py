"""Products of matrices in the precision of their numbers."""

import functools
from collections.abc import Callable

import jax


def full_precision(f: Callable) -> Callable:
    """The same function, all of whose matrix products JAX is asked for in full precision.

    A GPU otherwise rounds the factors of float32 products to ten bits, a relative error of 1e-3.
    The request is made while `f` is traced; derivatives of the products inherit it.
    """

    @functools.wraps(f)
    def precise(*args, **kwargs):
        with jax.default_matmul_precision("highest"):
            return f(*args, **kwargs)

    return precise
