"""What the answers of a joint type have to do with each other; for one more type, too."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helical import HELICAL
from oracle import quick_jit

from jaxsim.arrays.polynomial import spring_energy, spring_force
from jaxsim.joints import JOINTS
from jaxsim.spatial import (
    cross_motion,
    quat_to_matrix,
    unskew,
)

TYPES = [*JOINTS.values(), HELICAL]
BOUNDS = jnp.array([-0.4, 0.7])


@pytest.fixture(scope="module", params=TYPES, ids=lambda joint: joint.name)
def law(request):
    """A type, and both sides of every law at four random configurations."""
    with jax.enable_x64(True):
        joint, rng = request.param, np.random.default_rng(0)
        q = jnp.asarray(rng.normal(size=(4, joint.nq)))
        # Unit quaternions, where there are any.
        q = jax.vmap(lambda q: joint.integrate(q, jnp.zeros(joint.nv), 0.0))(q)
        v, theta = jnp.asarray(0.7 * rng.normal(size=(2, 4, joint.nv)))
        axis = rng.normal(size=3)
        axis = jnp.asarray(axis / np.linalg.norm(axis))
        anchor = jnp.asarray(rng.normal(size=3))
        compute = quick_jit(jax.vmap(lambda q, v, theta: laws(joint, q, v, theta, axis, anchor)))
        return joint, jax.tree.map(np.asarray, compute(q, v, theta))


def laws(joint, q, v, theta, axis, anchor) -> dict[str, tuple]:
    """Pairs of what must be equal."""
    along = lambda f: _rate(lambda t: f(joint.integrate(q, v, t)))  # noqa: E731
    q0 = joint.integrate(q, theta, 1.0)
    twist, axes_rate = _twist(joint, q, q0, v, axis, anchor)
    axes = _axes(joint, q, q0, axis, anchor)
    k, poly = jnp.asarray(2.0), jnp.array([0.3, 0.2])
    energy = lambda q: sum(spring_energy(k, poly, x) for x in joint.deflections(q, q0))  # noqa: E731
    force = jnp.concatenate([spring_force(k, poly, x) for x in joint.deflections(q, q0)])
    reached = lambda h: joint.integrate(  # noqa: E731
        q, theta + h * joint.exponential_rate(v, theta), 1.0
    )
    lower, upper, gradient = joint.limit(q, BOUNDS)
    lower_rate, upper_rate = (
        jnp.where(
            jnp.isfinite(end), along(lambda q, i=i: joint.limit(q, BOUNDS)[i]), sign * gradient @ v
        )
        for i, (end, sign) in enumerate(((lower, 1), (upper, -1)))
    )
    return {
        "difference inverts integrate": (joint.difference(q, joint.integrate(q, v, 1.0)), v),
        "integrate inverts difference": (
            joint.difference(joint.integrate(q, joint.difference(q, q0), 1.0), q0),
            jnp.zeros(joint.nv),
        ),
        "motion axes are the rate of the pose": (v @ axes, twist),
        "axes turn with the link or stay": (
            axes_rate,
            jnp.where(
                jnp.array(joint.turns)[:, None], jax.vmap(cross_motion, (None, 0))(twist, axes), 0
            ),
        ),
        "exponential rate": (_rate(lambda h: joint.difference(reached(0.0), reached(h))), v),
        "spring force is minus the gradient of its energy": (-along(energy), force @ v),
        "gradient of the lower limit": (lower_rate, gradient @ v),
        "gradient of the upper limit": (upper_rate, -gradient @ v),
    }


def _axes(joint, q, q0, axis, anchor):
    pose = joint.pose(q, q0, axis, anchor)
    return joint.motion_axes(quat_to_matrix(pose.quat), pose.pos, axis, anchor)


def _twist(joint, q, q0, v, axis, anchor):
    """Spatial twist of the link about the origin of the joint's frame, and the axes' rates."""

    def at(t):
        moved = joint.integrate(q, v, t)
        pose = joint.pose(moved, q0, axis, anchor)
        return quat_to_matrix(pose.quat), pose.pos, _axes(joint, moved, q0, axis, anchor)

    (R, p, _), (dR, dp, axes_rate) = jax.jvp(at, (0.0,), (1.0,))
    omega = unskew(dR @ R.T)
    return jnp.concatenate([omega, dp - jnp.cross(omega, p)]), axes_rate


def _rate(f):
    """Derivative of f at zero."""
    return jax.jvp(f, (0.0,), (1.0,))[1]


def test_laws(law):
    _, pairs = law
    for name, (left, right) in pairs.items():
        np.testing.assert_allclose(left, right, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("joint", TYPES, ids=lambda joint: joint.name)
def test_sizes(joint):
    assert len(joint.turns) == sum(joint.parts) == joint.nv


@pytest.mark.parametrize("joint", TYPES, ids=lambda joint: joint.name)
def test_pose_counts_from_the_reference_or_is_the_pose_in_the_world(joint):
    q0 = joint.integrate(jnp.eye(joint.nq)[-1], jnp.full(joint.nv, 0.3), 1.0)
    axis, anchor = jnp.array([0.0, 0.6, 0.8]), jnp.array([0.1, 0.2, 0.3])
    pose = joint.pose(q0, q0, axis, anchor)
    if joint.in_world:
        np.testing.assert_allclose(jnp.concatenate([pose.pos, pose.quat]), q0, atol=1e-15)
    elif joint.nq == 1:
        np.testing.assert_allclose(pose.pos, 0, atol=1e-15)
        np.testing.assert_allclose(pose.quat, [1, 0, 0, 0], atol=1e-15)
