"""Rods of 1:500 in float32: their smallest inertia is below the rounding of their largest."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from oracle import quick_jit

import jaxsim

RADIUS, HALF_LENGTH = 2e-4, 0.1
ROD = f"""
<mujoco>
  <option cone="pyramidal" tolerance="0" gravity="0 0 {{gravity}}"/>
  <default><geom friction=".01 0 0"/></default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 {{height}}"><freejoint/>
      <geom type="capsule" size="{RADIUS} {HALF_LENGTH}" mass="1"/></body>
  </worldbody>
</mujoco>
"""


def _accelerations(mj: mujoco.MjModel, qpos, qvel):
    """Of states of one body, by jaxsim in float32 and by MuJoCo C from the same numbers."""
    qpos, qvel = (np.asarray(x, np.float32) for x in (qpos, qvel))
    with jax.enable_x64(False):
        model = jaxsim.load(mj)
        start = jaxsim.make_state(model)
        one = lambda q, v: jaxsim.forward(model, start.replace(qpos=q, qvel=v)).qacc  # noqa: E731
        found = np.asarray(quick_jit(jax.vmap(one))(jnp.asarray(qpos), jnp.asarray(qvel)))
    expected, data = [], mujoco.MjData(mj)
    for q, v in zip(qpos, qvel, strict=True):
        data.qpos[:], data.qvel[:], data.qacc_warmstart[:] = q, v, 0
        mujoco.mj_forward(mj, data)
        expected.append(data.qacc.copy())
    return found, np.array(expected)


def _flat(heading: np.ndarray) -> np.ndarray:
    """Orientations in which the rod is level."""
    half = 0.5 * heading
    return np.stack([np.cos(half), -np.sin(half), np.cos(half), np.sin(half)], 1) / np.sqrt(2)


def test_a_spinning_rod_in_flight_keeps_its_spin():
    """No torque acts about the axis of a symmetric body; the others are gyroscopic."""
    rng, n = np.random.default_rng(0), 16
    mj = mujoco.MjModel.from_xml_string(ROD.format(gravity=0, height=1))
    quat = rng.normal(size=(n, 4))
    qpos = np.concatenate(
        [rng.normal(size=(n, 2)), np.ones((n, 1)), quat / np.linalg.norm(quat, axis=1)[:, None]], 1
    )
    qvel = np.concatenate(
        [rng.normal(size=(n, 3)), 5 * rng.normal(size=(n, 2)), 300 + 0 * quat[:, :1]], 1
    )
    found, expected = _accelerations(mj, qpos, qvel)
    np.testing.assert_allclose(found[:, :5], expected[:, :5], rtol=1e-5, atol=1e-4)
    np.testing.assert_allclose(found[:, 5], 0, atol=1e-3)


def test_a_rod_that_slides_sideways_is_spun_by_friction():
    """It lies on both ends, which push and spin it as in MuJoCo."""
    n, rng = 16, np.random.default_rng(1)
    mj = mujoco.MjModel.from_xml_string(ROD.format(gravity=-9.81, height=RADIUS))
    heading = rng.uniform(-3, 3, n)
    depth = rng.uniform(1e-6, 2e-5, (n, 1))
    qpos = np.concatenate([np.zeros((n, 2)), RADIUS - depth, _flat(heading)], 1)
    qvel = np.zeros((n, 6))
    qvel[:, 0], qvel[:, 1] = -0.3 * np.sin(heading), 0.3 * np.cos(heading)
    qvel[:, 5] = rng.uniform(-200, 200, n)
    found, expected = _accelerations(mj, qpos, qvel)
    assert np.abs(expected[:, 5]).min() > 100
    np.testing.assert_allclose(found[:, 5], expected[:, 5], rtol=1e-2)
    np.testing.assert_allclose(found[:, :3], expected[:, :3], atol=1e-2)
