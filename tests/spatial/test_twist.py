"""Twists and wrenches: Ad is a homomorphism, ad its derivative, and power has no frame."""

import doctest

import jax
import jax.numpy as jnp
import numpy as np
from numpy.testing import assert_allclose

import jaxsim.spatial.twist
from jaxsim.spatial import (
    Pose,
    acceleration_at,
    ad,
    adjoint,
    body_twist,
    body_wrench,
    coadjoint,
    cross_force,
    cross_motion,
    power,
    quat_from_axis_angle,
    se3_exp,
    se3_log,
    spatial_twist,
    spatial_wrench,
    twist_at,
    wrench_from,
)


def apply(matrices, columns):
    return jnp.einsum("nij,nj->ni", matrices, columns)


def test_adjoint_is_a_homomorphism(poses, precision):
    other = jax.tree.map(lambda x: x[::-1], poses)
    for function in (adjoint, coadjoint):
        ad_a, ad_b = jax.vmap(function)(poses), jax.vmap(function)(other)
        product = jax.vmap(lambda a, b, f=function: f(a @ b))(poses, other)
        assert_allclose(product, ad_a @ ad_b, rtol=0, atol=16 * precision.atol)


def test_coadjoint_is_the_inverse_transpose(poses, precision):
    product = jnp.einsum("nji,njk->nik", jax.vmap(adjoint)(poses), jax.vmap(coadjoint)(poses))
    expected = np.tile(np.eye(6), (len(product), 1, 1))
    assert_allclose(product, expected, rtol=0, atol=16 * precision.atol)


def test_adjoint_conjugates_the_exponential(poses, twists, precision):
    """``X exp(V) X^-1 = exp(Ad_X V)``, which is what makes it *the* adjoint."""
    V = 0.3 * twists

    def sides(X, V):
        left = (X @ se3_exp(V) @ X.inverse()).as_matrix()
        return left, se3_exp(adjoint(X) @ V).as_matrix()

    left, right = jax.vmap(sides)(poses, V)
    assert_allclose(left, right, rtol=0, atol=16 * precision.atol)


def test_ad_is_the_derivative_of_adjoint(x64, rng):
    V = jnp.asarray(rng.normal(size=(20, 6)))

    def rate(V):
        return jax.jvp(lambda t: adjoint(se3_exp(t * V)), (0.0,), (1.0,))[1]

    assert_allclose(jax.jit(jax.vmap(rate))(V), jax.vmap(ad)(V), atol=1e-14)


def test_cross_products_are_ad_and_its_negative_transpose(twists, precision):
    V, W = twists, twists[::-1]
    ad_V = jax.vmap(ad)(V)
    assert_allclose(jax.vmap(cross_motion)(V, W), apply(ad_V, W), atol=8 * precision.atol)
    expected = -jnp.einsum("nji,nj->ni", ad_V, W)
    assert_allclose(jax.vmap(cross_force)(V, W), expected, atol=8 * precision.atol)


def test_cross_motion_is_a_lie_bracket(twists, precision):
    a, b, c = twists, twists[::-1], jnp.roll(twists, 5, axis=0)
    bracket = jax.vmap(cross_motion)
    assert_allclose(bracket(a, b), -bracket(b, a), atol=precision.atol)
    jacobi = bracket(a, bracket(b, c)) + bracket(b, bracket(c, a)) + bracket(c, bracket(a, b))
    assert_allclose(jacobi, np.zeros(jacobi.shape), atol=64 * precision.atol)


def test_power_does_not_depend_on_the_frame(poses, twists, precision):
    V, F = twists, twists[::-1]
    in_body = jax.vmap(power)(V, F)
    in_space = jax.vmap(power)(
        jax.vmap(spatial_twist)(poses, V), jax.vmap(spatial_wrench)(poses, F)
    )
    assert_allclose(in_space, in_body, rtol=0, atol=64 * precision.atol)


def test_changes_of_frame_are_the_matrices_and_invert_each_other(poses, twists, precision):
    tolerance = {"rtol": 0, "atol": 16 * precision.atol}
    for matrix, there, back in (
        (adjoint, spatial_twist, body_twist),
        (coadjoint, spatial_wrench, body_wrench),
    ):
        moved = jax.vmap(there)(poses, twists)
        assert_allclose(moved, apply(jax.vmap(matrix)(poses), twists), **tolerance)
        assert_allclose(jax.vmap(back)(poses, moved), twists, **tolerance)


def test_twists_are_the_derivatives_of_the_pose(x64, rng):
    """``X exp(V_body t)`` and ``exp(V_spatial t) X`` leave ``X`` in the same way."""
    X, V = se3_exp(jnp.asarray(rng.normal(size=6))), jnp.asarray(rng.normal(size=6))

    def rate(motion):
        return jax.jit(lambda: jax.jvp(lambda t: motion(t).as_matrix(), (0.0,), (1.0,))[1])()

    by_body = rate(lambda t: X @ se3_exp(t * V))
    by_space = rate(lambda t: se3_exp(t * spatial_twist(X, V)) @ X)
    assert_allclose(by_body, by_space, atol=1e-14)


def test_moving_by_an_arm_is_a_change_of_frame_without_rotation(twists, vectors, precision):
    arms = jnp.asarray(vectors, precision.dtype)

    def sides(V, F, arm):
        base = Pose(quat=jnp.eye(4, dtype=arm.dtype)[0], pos=-arm)
        moved = twist_at(V, arm), wrench_from(F, arm)
        return moved, (adjoint(base) @ V, coadjoint(base.inverse()) @ F)

    moved, expected = jax.vmap(sides)(twists, twists[::-1], arms)
    for a, b in zip(moved, expected, strict=True):
        assert_allclose(a, b, rtol=0, atol=16 * precision.atol)


def test_acceleration_of_a_point_is_the_rate_of_its_velocity(x64, rng):
    """Of a body whose twist about a point fixed in space changes at a constant rate."""
    V, A = jnp.asarray(rng.normal(size=(2, 6)))
    arm = jnp.asarray(rng.normal(size=3))

    def velocity(t, point):
        return twist_at(V + t * A, point)[3:]

    _, rate = jax.jvp(velocity, (0.0, arm), (1.0, velocity(0.0, arm)))
    moved = acceleration_at(A, V, arm)
    assert_allclose(moved[3:], rate, atol=1e-14)
    assert_allclose(moved[:3], A[:3])


def test_worked_example():
    """A body turns at 1 rad/s about z and moves at 0.5 m/s along x, seen from both frames."""
    angle = jnp.asarray(np.pi / 2)
    quat = quat_from_axis_angle(jnp.array([0.0, 0.0, 1.0]), angle)
    X_WB = Pose(quat=quat, pos=jnp.array([2.0, 0.0, 0.0]))
    V_spatial = adjoint(X_WB) @ jnp.array([0.0, 0.0, 1.0, 0.0, -0.5, 0.0])
    assert_allclose(V_spatial, [0.0, 0.0, 1.0, 0.5, -2.0, 0.0], atol=1e-6)
    # It circles the point where the spatial twist vanishes, at a radius of 0.5 m.
    centre = X_WB.pos + jnp.array([0.0, 0.5, 0.0])
    assert_allclose(V_spatial[3:] + jnp.cross(V_spatial[:3], centre), np.zeros(3), atol=1e-6)
    turn = se3_exp(2 * np.pi * V_spatial) @ X_WB
    assert_allclose(turn.pos, X_WB.pos, atol=1e-5)


def test_documentation_example_runs():
    results = doctest.testmod(jaxsim.spatial.twist)
    assert results.attempted > 0
    assert results.failed == 0


def test_screw_motion_has_its_twist_as_logarithm(x64):
    V = jnp.array([0.0, 0.0, 1.0, 0.5, -2.0, 0.1])
    assert_allclose(se3_log(se3_exp(V)), V, atol=1e-14)
