"""Quaternions: group laws, exponential and logarithm, and MuJoCo's functions as the reference."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxsim.spatial import (
    quat_conj,
    quat_difference,
    quat_exp,
    quat_from_axis_angle,
    quat_from_matrix,
    quat_integrate,
    quat_inv_rotate,
    quat_log,
    quat_mul,
    quat_normalize,
    quat_rotate,
    quat_to_matrix,
)

IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def mujoco_result(function, size, *arguments):
    """Result of a mju function that writes into its first argument, over rows of arguments."""
    rows = []
    for row in zip(*arguments, strict=True):
        result = np.zeros(size)
        function(result, *(np.array(x, dtype=np.float64) for x in row))
        rows.append(result)
    return np.array(rows)


def assert_same_rotation(a, b, atol):
    sign = np.where(np.sum(np.asarray(a) * np.asarray(b), axis=1) < 0, -1.0, 1.0)
    assert_allclose(np.asarray(a) * sign[:, None], b, rtol=0, atol=atol)


def test_product_is_associative_with_identity_and_inverse(quats, precision):
    a, b, c = quats, quats[::-1], jnp.roll(quats, 5, axis=0)
    mul = jax.vmap(quat_mul)
    one = jnp.broadcast_to(jnp.asarray(IDENTITY, precision.dtype), a.shape)
    assert_allclose(mul(mul(a, b), c), mul(a, mul(b, c)), rtol=0, atol=precision.atol)
    assert_allclose(mul(a, jax.vmap(quat_conj)(a)), one, rtol=0, atol=precision.atol)
    assert_allclose(mul(a, one), a)
    assert_allclose(mul(one, a), a)


def test_product_of_basis_is_hamiltons():
    i, j, k = jnp.eye(4)[1:]
    assert_allclose(quat_mul(i, j), k)
    assert_allclose(quat_mul(j, k), i)
    assert_allclose(quat_mul(k, i), j)


def test_rotation_acts_from_the_left(quats, vectors, precision):
    a, b, v = quats, quats[::-1], jnp.asarray(vectors, precision.dtype)
    rotate = jax.vmap(quat_rotate)
    composed = rotate(jax.vmap(quat_mul)(a, b), v)
    assert_allclose(composed, rotate(a, rotate(b, v)), rtol=0, atol=4 * precision.atol)
    assert_allclose(jax.vmap(quat_inv_rotate)(a, rotate(a, v)), v, rtol=0, atol=4 * precision.atol)


def test_quarter_turn_about_z_takes_x_to_y():
    q = quat_from_axis_angle(jnp.array([0.0, 0.0, 1.0]), jnp.asarray(np.pi / 2))
    assert_allclose(quat_rotate(q, jnp.array([1.0, 0.0, 0.0])), [0.0, 1.0, 0.0], atol=1e-7)


def test_matrix_agrees_with_rotation_and_converts_back(quats, vectors, precision):
    v = jnp.asarray(vectors, precision.dtype)
    R = jax.vmap(quat_to_matrix)(quats)
    assert_allclose(
        jnp.einsum("nij,nj->ni", R, v), jax.vmap(quat_rotate)(quats, v), atol=4 * precision.atol
    )
    back = jax.vmap(quat_from_matrix)(R)
    assert (back[:, 0] >= 0).all()
    assert_same_rotation(back, quats, precision.atol)


def test_log_inverts_exp(rotation_vectors, precision):
    w = jnp.asarray(rotation_vectors, precision.dtype)
    back = jax.vmap(lambda x: quat_log(quat_exp(x)))(w)
    errors, length = np.linalg.norm(back - w, axis=1), np.linalg.norm(w, axis=1)
    # Relative to each vector, so that the smallest angles keep all their digits too.
    assert (errors <= precision.atol * length)[length < 3.1415].all()


def test_exp_inverts_log_up_to_sign_and_takes_the_short_way(quats, precision):
    w = jax.vmap(quat_log)(quats)
    assert_same_rotation(jax.vmap(quat_exp)(w), quats, precision.atol)
    assert (np.linalg.norm(w, axis=1) <= np.pi + precision.atol).all()


def test_log_is_the_same_on_both_covers_and_for_any_norm(quats, precision):
    inside = np.abs(quats[:, 0]) > 1e-3
    w = jax.vmap(quat_log)(quats)[inside]
    assert_allclose(jax.vmap(quat_log)(-quats)[inside], w)
    scaled = jax.vmap(quat_log)(1e-3 * quats)[inside]
    assert_allclose(scaled, w, rtol=precision.atol, atol=1e-30)


def test_log_of_exact_half_turn_and_of_zero():
    assert_allclose(quat_log(jnp.array([0.0, 0.0, -1.0, 0.0])), [0.0, -np.pi, 0.0], rtol=1e-6)
    assert_allclose(quat_log(jnp.zeros(4)), np.zeros(3))


def test_exp_of_many_turns():
    w = jnp.array([0.0, 0.0, 6 * np.pi + 0.3])
    expected = quat_from_axis_angle(jnp.array([0.0, 0.0, 1.0]), jnp.asarray(0.3))
    assert_allclose(quat_exp(w), -expected, atol=1e-5)


def test_normalize_keeps_direction_and_maps_zero_to_identity(quats, precision):
    scaled = jax.vmap(quat_normalize)(1e-6 * quats)
    assert_allclose(scaled, quats, rtol=0, atol=precision.atol)
    zero = jax.vmap(quat_normalize)(1e-17 * quats)
    assert_allclose(zero, np.tile(IDENTITY, (len(zero), 1)))


def test_normalize_does_not_hide_nan():
    assert jnp.isnan(quat_normalize(jnp.array([jnp.nan, 0.0, 0.0, 1.0]))).any()


def test_integrating_the_difference_arrives(quats, precision):
    a, b = quats, quats[::-1]
    w = jax.vmap(quat_difference)(a, b)
    there = jax.vmap(lambda q, rate: quat_integrate(q, rate / 0.1, 0.1))(a, w)
    assert_same_rotation(there, b, 2 * precision.atol)


def test_body_rate_is_in_body_axes(x64):
    q = quat_exp(jnp.array([0.0, 0.0, np.pi / 2]))
    turned = quat_integrate(q, jnp.array([0.3, 0.0, 0.0]), 1.0)
    # The body's x axis points along the world's y.
    expected = quat_mul(quat_exp(jnp.array([0.0, 0.3, 0.0])), q)
    assert_allclose(turned, expected, atol=1e-15)


def test_dtype_of_arguments_is_kept(quats, vectors, precision):
    v = jnp.asarray(vectors[0], precision.dtype)
    q = quats[0]
    for result in (
        quat_exp(v),
        quat_log(q),
        quat_normalize(q),
        quat_integrate(q, v, 0.1),
        quat_from_axis_angle(v, v[0]),
        quat_from_matrix(quat_to_matrix(q)),
    ):
        assert result.dtype == precision.dtype


def test_matrix_of_wrong_shape_is_refused():
    with pytest.raises(ValueError, match=r"shape \(3, 3\), not \(4, 4\)"):
        quat_from_matrix(jnp.eye(4))


@pytest.mark.usefixtures("x64")
class TestAgainstMuJoCo:
    """The reference computes in float64, so these run in float64 only."""

    @pytest.fixture
    def q(self, rotation_vectors):
        q = jax.vmap(quat_exp)(jnp.asarray(rotation_vectors))
        return q * jnp.where(jnp.arange(len(q)) % 2 == 0, 1.0, -1.0)[:, None]

    def test_product(self, q):
        expected = mujoco_result(mujoco.mju_mulQuat, 4, q, q[::-1])
        assert_allclose(jax.vmap(quat_mul)(q, q[::-1]), expected, atol=1e-15)

    def test_rotation_of_vectors(self, q, vectors):
        expected = mujoco_result(mujoco.mju_rotVecQuat, 3, vectors, q)
        assert_allclose(jax.vmap(quat_rotate)(q, jnp.asarray(vectors)), expected, atol=1e-14)

    def test_matrices(self, q):
        expected = mujoco_result(mujoco.mju_quat2Mat, 9, q)
        R = jax.vmap(quat_to_matrix)(q)
        assert_allclose(R.reshape(-1, 9), expected, atol=1e-15)
        back = mujoco_result(mujoco.mju_mat2Quat, 4, expected)
        assert_same_rotation(jax.vmap(quat_from_matrix)(R), back, 1e-14)

    def test_logarithm(self, q):
        expected = mujoco_result(lambda res, x: mujoco.mju_quat2Vel(res, x, 1.0), 3, q)
        # Beyond rounding of the half turn itself, where both signs are right.
        inside = np.abs(q[:, 0]) > 1e-15
        assert_allclose(jax.vmap(quat_log)(q)[inside], expected[inside], atol=1e-14)

    def test_difference_is_sub_quat_with_the_order_exchanged(self, q):
        other = jnp.roll(q, 3, axis=0)
        expected = mujoco_result(mujoco.mju_subQuat, 3, other, q)
        inside = np.linalg.norm(expected, axis=1) < np.pi - 1e-9
        assert inside.sum() > 50
        actual = jax.vmap(quat_difference)(q, other)
        assert_allclose(actual[inside], expected[inside], atol=1e-13)

    def test_integration_of_quaternions_of_any_norm(self, q, vectors):
        q = 1.7 * q
        actual = jax.vmap(lambda a, w: quat_integrate(a, w, 0.3))(q, jnp.asarray(vectors))
        expected = np.array(q)
        for row, w in zip(expected, vectors, strict=True):
            mujoco.mju_quatIntegrate(row, w, 0.3)
        assert_allclose(actual, expected, atol=1e-14)

    def test_axis_and_angle(self, vectors):
        axes = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
        for angle in (0.0, 1.3, np.pi):
            expected = mujoco_result(
                lambda res, axis, angle=angle: mujoco.mju_axisAngle2Quat(res, axis, angle), 4, axes
            )
            actual = jax.vmap(quat_from_axis_angle, (0, None))(jnp.asarray(axes), angle)
            assert_allclose(actual, expected, atol=1e-15)
