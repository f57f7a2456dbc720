"""Rotation matrices against the matrix exponential and the cross product."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxsim.spatial import skew, so3_exp, so3_log, unskew


def test_skew_is_the_cross_product_and_unskew_inverts_it(vectors, precision):
    a = jnp.asarray(vectors, precision.dtype)
    b = a[::-1]
    S = jax.vmap(skew)(a)
    assert_allclose(jnp.einsum("nij,nj->ni", S, b), jnp.cross(a, b), atol=precision.atol)
    assert_allclose(jax.vmap(unskew)(S), a)


def test_unskew_ignores_the_symmetric_part():
    assert_allclose(unskew(skew(jnp.arange(3.0)) + jnp.ones((3, 3))), np.arange(3.0))


def test_exp_is_the_matrix_exponential(rotation_vectors, x64):
    w = jnp.asarray(rotation_vectors)
    expected = jax.vmap(lambda x: jax.scipy.linalg.expm(skew(x)))(w)
    assert_allclose(jax.vmap(so3_exp)(w), expected, atol=1e-13)


def test_exp_is_orthogonal_and_right_handed(rotation_vectors, precision):
    R = jax.vmap(so3_exp)(jnp.asarray(rotation_vectors, precision.dtype))
    gram = jnp.einsum("nij,nkj->nik", R, R)
    assert_allclose(gram, np.tile(np.eye(3), (len(R), 1, 1)), rtol=0, atol=precision.atol)
    assert_allclose(np.linalg.det(R), np.ones(len(R)), atol=precision.atol)


def test_log_inverts_exp(rotation_vectors, precision):
    w = jnp.asarray(rotation_vectors, precision.dtype)
    back = jax.vmap(lambda x: so3_log(so3_exp(x)))(w)
    assert_allclose(jax.vmap(so3_exp)(back), jax.vmap(so3_exp)(w), rtol=0, atol=precision.atol)
    inside = np.linalg.norm(rotation_vectors, axis=1) < 3.1415
    assert_allclose(back[inside], w[inside], rtol=0, atol=precision.atol)
    # Small rotations keep their digits, which the trace of the matrix would lose.
    small = (np.linalg.norm(rotation_vectors, axis=1) < 1e-3) & rotation_vectors.any(axis=1)
    errors = np.linalg.norm(back - w, axis=1)[small]
    assert (errors <= precision.atol * np.linalg.norm(w, axis=1)[small]).all()


@pytest.mark.parametrize("function", [so3_log, unskew])
def test_wrong_shape_is_refused(function):
    with pytest.raises(ValueError, match=r"shape \(3, 3\), not \(3,\)"):
        function(jnp.zeros(3))
