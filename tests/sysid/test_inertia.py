"""Log-Cholesky coordinates: a chart of what is physical, smooth where moments are equal."""

import jax
import jax.numpy as jnp
import numpy as np

import jaxsim
from jaxsim.spatial import quat_to_matrix
from jaxsim.sysid.inertia import from_log_cholesky, principal_axes, to_log_cholesky

BODY = """
<mujoco><worldbody><body><freejoint/>
  <inertial mass="2" pos=".1 -.2 .3" fullinertia=".05 .04 .06 .005 -.004 .003"/>
</body></worldbody></mujoco>
"""


def rotational(model):
    R = quat_to_matrix(model.body_iquat[1])
    return R @ jnp.diag(model.body_inertia[1]) @ R.T


def test_there_and_back(x64):
    model = jaxsim.load(BODY)
    x, length = to_log_cholesky(model, 1)
    found = from_log_cholesky(model, 1, x, length)
    np.testing.assert_allclose(found.body_mass[1], 2, rtol=1e-12)
    np.testing.assert_allclose(found.body_ipos[1], [0.1, -0.2, 0.3], rtol=1e-12)
    # Moments are set apart by the root of the precision.
    np.testing.assert_allclose(rotational(found), rotational(model), atol=1e-8)


def test_every_point_is_physical(x64, rng):
    model = jaxsim.load(BODY)
    _, length = to_log_cholesky(model, 1)
    points = jnp.asarray(rng.normal(size=(50, 10)))
    found = jax.vmap(lambda x: from_log_cholesky(model, 1, x, length))(points)
    moments = found.body_inertia[:, 1]
    assert (found.body_mass[:, 1] > 0).all()
    assert (moments > 0).all()
    assert (2 * moments.max(1) <= moments.sum(1) * (1 + 1e-6)).all()


def test_derivative_where_moments_are_equal(x64, rng):
    """Moments and axes have none there, the matrix that they make has."""

    def again(matrix):
        moments, quat = principal_axes(matrix)
        R = quat_to_matrix(quat)
        return R @ jnp.diag(moments) @ R.T

    change = jnp.asarray(rng.normal(size=(3, 3)))
    change = change + change.T
    for matrix in (jnp.eye(3), jnp.diag(jnp.array([2.0, 1.0, 2.0]))):
        value, rate = jax.jvp(again, (matrix,), (change,))
        np.testing.assert_allclose(value, matrix, atol=1e-7)
        np.testing.assert_allclose(rate, change, atol=1e-6)
