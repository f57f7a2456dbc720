"""Poses: group laws, homogeneous matrices, exponential and logarithm."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxsim.spatial import Pose, quat_exp, se3_exp, se3_log, skew


def matrices(poses):
    return np.asarray(jax.vmap(Pose.as_matrix)(poses))


def reverse(poses):
    return jax.tree.map(lambda x: x[::-1], poses)


def test_composition_is_the_product_of_matrices(poses, precision):
    other = reverse(poses)
    actual = matrices(jax.vmap(Pose.compose)(poses, other))
    assert_allclose(actual, matrices(poses) @ matrices(other), rtol=0, atol=4 * precision.atol)
    assert_allclose(matrices(jax.vmap(lambda a, b: a @ b)(poses, other)), actual)


def test_composition_is_associative(poses, precision):
    a, b, c = poses, reverse(poses), jax.tree.map(lambda x: jnp.roll(x, 5, axis=0), poses)
    left = matrices(jax.vmap(lambda a, b, c: (a @ b) @ c)(a, b, c))
    right = matrices(jax.vmap(lambda a, b, c: a @ (b @ c))(a, b, c))
    assert_allclose(left, right, rtol=0, atol=4 * precision.atol)


def test_inverse_and_identity(poses, precision):
    one = np.tile(np.eye(4), (len(poses.pos), 1, 1))
    product = matrices(jax.vmap(lambda x: x @ x.inverse())(poses))
    assert_allclose(product, one, rtol=0, atol=4 * precision.atol)
    with_identity = jax.vmap(lambda x: x @ Pose.identity(precision.dtype))(poses)
    assert_allclose(matrices(with_identity), matrices(poses))
    assert with_identity.pos.dtype == precision.dtype


def test_points_map_as_by_the_matrix(poses, vectors, precision):
    points = jnp.asarray(vectors[::-1], precision.dtype)
    expected = np.einsum("nij,nj->ni", matrices(poses)[:, :3, :3], points) + poses.pos
    actual = jax.vmap(Pose.apply)(poses, points)
    assert_allclose(actual, expected, rtol=0, atol=4 * precision.atol)


def test_matrix_round_trip(poses, precision):
    back = jax.vmap(lambda x: Pose.from_matrix(x.as_matrix()))(poses)
    assert_allclose(matrices(back), matrices(poses), rtol=0, atol=precision.atol)


def test_exp_is_the_matrix_exponential(rotation_vectors, vectors, x64):
    V = jnp.concatenate([jnp.asarray(rotation_vectors), jnp.asarray(vectors)], axis=1)

    def reference(twist):
        top = jnp.concatenate([skew(twist[:3]), twist[3:, None]], axis=1)
        return jax.scipy.linalg.expm(jnp.concatenate([top, jnp.zeros((1, 4))]))

    actual = matrices(jax.vmap(se3_exp)(V))
    assert_allclose(actual, jax.vmap(reference)(V), rtol=0, atol=1e-13)


def test_log_inverts_exp(rotation_vectors, vectors, precision):
    inside = np.linalg.norm(rotation_vectors, axis=1) < 3.1415
    V = jnp.asarray(np.concatenate([rotation_vectors, vectors], axis=1), precision.dtype)
    back = jax.vmap(lambda x: se3_log(se3_exp(x)))(V)
    assert_allclose(back[inside], V[inside], rtol=0, atol=4 * precision.atol)


def test_exp_inverts_log(poses, precision):
    back = jax.vmap(lambda x: se3_exp(se3_log(x)))(poses)
    assert_allclose(matrices(back), matrices(poses), rtol=0, atol=4 * precision.atol)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(3), r"shape \(4, 4\), not \(3, 3\)"),
        (2.0 * np.eye(4), "must be orthogonal"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "must not be a reflection"),
        (np.eye(4) + np.eye(4)[[3]].T @ np.eye(4)[[0]], "last row"),
    ],
)
def test_matrix_that_is_not_a_pose_is_refused(matrix, message):
    with pytest.raises(ValueError, match=message):
        Pose.from_matrix(matrix)


def test_host_matrix_is_accepted_as_list_and_array():
    expected = Pose(quat=quat_exp(jnp.zeros(3)), pos=jnp.array([1.0, 2.0, 3.0]))
    matrix = np.eye(4)
    matrix[:3, 3] = [1.0, 2.0, 3.0]
    for source in (matrix, matrix.tolist()):
        pose = Pose.from_matrix(source)
        assert_allclose(pose.quat, expected.quat)
        assert_allclose(pose.pos, expected.pos)
