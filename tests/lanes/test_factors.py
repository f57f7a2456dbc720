"""Factorisations of several matrices in each lane."""

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from oracle import quick_jit

from jaxsim.lanes import as_kernel

RNG = np.random.default_rng(4)


def test_lu_of_several_matrices(x64):
    """The same pivots as LAPACK's, and factors to rounding."""
    matrices = jnp.asarray(RNG.normal(size=(19, 2, 4, 4)))
    found = quick_jit(jax.vmap(as_kernel(lax.linalg.lu)))(matrices)
    expected = quick_jit(jax.vmap(lax.linalg.lu))(matrices)
    for a, b in zip(found, expected, strict=True):
        assert a.dtype == b.dtype
        np.testing.assert_allclose(a, b, rtol=1e-12, atol=1e-12)


def test_cholesky_and_substitution_of_several_matrices(x64):
    half = RNG.normal(size=(19, 2, 4, 4))
    matrices = jnp.asarray(half @ np.swapaxes(half, -1, -2) + np.eye(4))
    right = jnp.asarray(RNG.normal(size=(19, 2, 4, 1)))

    def solve(matrix, right):
        lower = lax.linalg.cholesky(matrix)
        return lower, lax.linalg.triangular_solve(lower, right, left_side=True, lower=True)

    lower, x = quick_jit(jax.vmap(as_kernel(solve)))(matrices, right)
    np.testing.assert_allclose(lower, np.linalg.cholesky(matrices), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(lower @ x, right, rtol=1e-10, atol=1e-10)
