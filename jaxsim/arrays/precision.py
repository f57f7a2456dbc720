"""Matrix products in full precision on accelerators."""

import functools
from collections.abc import Callable

import jax


def full_precision(f: Callable) -> Callable:
    """Return `f` with all its matrix products computed in full precision.

    By default a GPU rounds the factors of float32 products to ten bits, a relative error of 1e-3.
    The precision is set while `f` is traced, and derivatives of its products inherit it.
    """

    @functools.wraps(f)
    def precise(*args, **kwargs):
        with jax.default_matmul_precision("highest"):
            return f(*args, **kwargs)

    return precise
