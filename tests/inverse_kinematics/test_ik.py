"""Inverse kinematics against forward kinematics, limits, and closed forms."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim import PoseTarget
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.spatial import quat_from_matrix

PLANAR = """
<mujoco><worldbody><body name="upper">
  <joint name="shoulder" axis="0 0 1" limited="true" range="-170 170"/>
  <geom size=".1" pos=".5 0 0"/>
  <body name="lower" pos="1 0 0"><joint name="elbow" axis="0 0 1" limited="true" range="0 150"/>
    <geom size=".1" pos=".5 0 0"/><site name="hand" pos="1 0 0"/></body>
</body>
<body name="free" pos="0 0 5"><freejoint/><geom size=".1"/></body>
<body name="head" pos="0 0 1"><joint name="neck" type="ball" limited="true" range="0 40"/>
  <geom size=".1"/><site name="nose" pos="1 0 0"/></body>
</worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def planar():
    return jaxsim.load(PLANAR)


def hand_poses(model, qpos):
    kin = kinematics(model, qpos)
    return kin.site_xpos[0], quat_from_matrix(kin.site_xmat[0])


def test_two_links_in_a_plane(planar):
    """The law of cosines gives the elbow; a limit decides between its two signs."""
    points = jnp.array([[1.2, 0.5, 0.0], [0.3, -1.0, 0.0], [-0.8, 1.0, 0.0], [3.0, 0.0, 0.0]])
    joints = ["shoulder", "elbow"]

    def reach(pos):
        return jaxsim.ik(planar, PoseTarget(pos, site="hand"), joints=joints, iterations=60)

    found = quick_jit(jax.vmap(reach))(points)
    np.testing.assert_array_equal(found.reached, [True, True, True, False])
    cosine = (jnp.sum(points[:3] ** 2, axis=1) - 2) / 2
    elbow = planar.jnt_qposadr[planar.names.id("joint", "elbow")]
    np.testing.assert_allclose(found.qpos[:3, elbow], jnp.arccos(cosine), atol=3e-3)
    # Out of reach: stretched towards it.
    np.testing.assert_allclose(found.qpos[3, :2], 0, atol=2e-2)
    np.testing.assert_allclose(found.pos_error[3], 1, atol=1e-3)
    # What may not move has not.
    np.testing.assert_array_equal(found.qpos[:, 2:], jnp.tile(planar.qpos0[None, 2:], (4, 1)))


def test_limit_of_a_ball_joint(planar):
    """The nose stops where the neck does, 40 degrees from straight ahead."""
    target = PoseTarget(jnp.array([0.0, 1.0, 1.0]), site="nose")
    found = quick_jit(lambda: jaxsim.ik(planar, target, joints=["neck"], iterations=40))()
    angle = 2 * np.arccos(found.qpos[-4])
    assert not found.reached
    np.testing.assert_allclose(np.rad2deg(angle), 40, atol=0.1)
    np.testing.assert_allclose(found.pos_error, 2 * np.sin(np.deg2rad(25)), atol=2e-3)


def test_two_targets_and_a_posture(planar):
    """A free body takes a pose; a posture decides what no target asks for."""
    quat = jnp.array([0.6, 0.0, 0.8, 0.0])
    posture = planar.qpos0.at[0].set(0.4)
    targets = [
        PoseTarget(jnp.array([1.0, 2.0, 3.0]), quat, body="free"),
        PoseTarget(quat=jnp.array([0.0, 0.0, 0.0, 1.0]), body="head"),
    ]
    found = quick_jit(lambda: jaxsim.ik(planar, targets, posture=posture, posture_weight=1e-3))()
    np.testing.assert_allclose(found.qpos[2:9], [1, 2, 3, *quat], atol=1e-4)
    np.testing.assert_allclose(found.qpos[:2], [0.4, 0], atol=1e-4)
    np.testing.assert_allclose(found.rot_error, np.deg2rad(140), atol=1e-3)


@pytest.mark.slow
def test_a_thousand_poses_of_an_arm(rng):
    """At least 99 of 100 poses that an arm with seven joints can take are found, within limits."""
    model = jaxsim.load("arm")
    low, high = np.asarray(model.jnt_range).T
    qpos = jnp.asarray(rng.uniform(low, high, (1000, 7)), jnp.float32)
    pos, quat = quick_jit(jax.vmap(lambda q: hand_poses(model, q)))(qpos)

    def reach(pos, quat):
        return jaxsim.ik(model, PoseTarget(pos, quat, site="hand"), start=model.key_qpos[0])

    found = quick_jit(jaxsim.vmap(reach))(pos, quat)
    assert found.reached.mean() >= 0.99
    assert ((found.qpos >= low - 1e-5) & (found.qpos <= high + 1e-5)).all()
    there = quick_jit(jax.vmap(lambda q: hand_poses(model, q)[0]))(found.qpos)
    distance = np.linalg.norm(there - pos, axis=1)
    np.testing.assert_allclose(distance, found.pos_error, atol=1e-5)
    assert (distance[np.asarray(found.reached)] < 1e-4 + 1e-6).all()


@pytest.mark.parametrize(
    ("target", "error", "message"),
    [
        (PoseTarget(jnp.zeros(3), site="hnd"), KeyError, "did you mean 'hand'"),
        (PoseTarget(jnp.zeros(3)), ValueError, "either a site or a body"),
        (PoseTarget(site="hand"), ValueError, "no pos and no quat"),
        (PoseTarget(jnp.zeros(2), site="hand"), ValueError, r"must have shape \(3,\)"),
        ("hand", TypeError, "PoseTarget"),
    ],
)
def test_wrong_targets_are_told(planar, target, error, message):
    with pytest.raises(error, match=message):
        jaxsim.ik(planar, [target])
    with pytest.raises(ValueError, match="at least one target"):
        jaxsim.ik(planar, [])
