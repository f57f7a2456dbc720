"""The Newton-Euler equation: momentum, energy, and MuJoCo's free body."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxsim.spatial import (
    Inertia,
    Pose,
    ad,
    body_wrench,
    newton_euler_acceleration,
    newton_euler_wrench,
    power,
    quat_from_axis_angle,
    quat_mul,
    quat_rotate,
    spatial_wrench,
)

STEPS = 1000


def motion_rate(G, F_W, state):
    """Derivatives of pose and body twist under a wrench that is constant in the world."""
    X, V = state
    spin = jnp.concatenate([jnp.zeros_like(V[:1]), V[:3]])
    X_rate = Pose(quat=0.5 * quat_mul(X.quat, spin), pos=quat_rotate(X.quat, V[3:]))
    return X_rate, newton_euler_acceleration(G, V, body_wrench(X, F_W))


@jax.jit
def simulate(G, V, F_W, duration):
    """Integrate with the classical Runge-Kutta method from the identity pose."""
    h = duration / STEPS

    def ahead(state, rate, time):
        return jax.tree.map(lambda x, d: x + time * d, state, rate)

    def advance(_, state):
        k1 = motion_rate(G, F_W, state)
        k2 = motion_rate(G, F_W, ahead(state, k1, h / 2))
        k3 = motion_rate(G, F_W, ahead(state, k2, h / 2))
        k4 = motion_rate(G, F_W, ahead(state, k3, h))
        rate = jax.tree.map(lambda a, b, c, d: (a + 2 * b + 2 * c + d) / 6, k1, k2, k3, k4)
        return ahead(state, rate, h)

    return jax.lax.fori_loop(0, STEPS, advance, (Pose.identity(V.dtype), V))


@pytest.fixture
def brick():
    """A tumbling body whose frame is away from its centre of mass."""
    moments = jnp.diag(jnp.array([0.2, 0.5, 0.6]))
    return Inertia.from_com(jnp.asarray(1.5), jnp.array([0.1, -0.2, 0.3]), moments)


def test_both_directions_invert_each_other(bodies, twists, precision):
    V, dV = twists, twists[::-1]

    def back(G, V, dV):
        return newton_euler_acceleration(G, V, newton_euler_wrench(G, V, dV))

    assert_allclose(jax.vmap(back)(bodies, V, dV), dV, rtol=0, atol=1000 * precision.atol)


def test_signs_of_the_body_form(bodies, twists, precision):
    """``F = G dV - ad(V)^T G V``, with matrices."""

    def reference(G, V, dV):
        return G.as_matrix() @ dV - ad(V).T @ (G.as_matrix() @ V)

    V, dV = twists, twists[::-1]
    expected = jax.vmap(reference)(bodies, V, dV)
    actual = jax.vmap(newton_euler_wrench)(bodies, V, dV)
    assert_allclose(actual, expected, rtol=0, atol=256 * precision.atol)


def test_eulers_equations_at_the_centre_of_mass():
    """``I dw + w x I w = torque`` for a body that spins about two axes."""
    G = Inertia.from_com(1.0, jnp.zeros(3), jnp.diag(jnp.array([1.0, 2.0, 3.0])))
    V = jnp.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    # w x I w = (0, 0, (I_y - I_x) w_x w_y) = (0, 0, 1), so dw_z = -1/3.
    assert_allclose(newton_euler_acceleration(G, V, jnp.zeros(6))[:3], [0, 0, -1 / 3], rtol=1e-6)


def test_free_motion_conserves_momentum_and_energy(x64, brick):
    V0 = jnp.array([0.3, 4.0, 0.2, 1.0, -0.5, 0.2])
    X, V = simulate(brick, V0, jnp.zeros(6), 3.0)
    assert jnp.linalg.norm(V - V0) > 1.0
    momentum = spatial_wrench(X, brick.apply(V))
    assert_allclose(momentum, brick.apply(V0), atol=1e-8)
    assert_allclose(brick.kinetic_energy(V), brick.kinetic_energy(V0), rtol=1e-9)


def test_a_wrench_changes_momentum_by_its_impulse(x64, brick):
    V0 = jnp.array([0.3, 1.0, 0.2, 1.0, -0.5, 0.2])
    F_W = jnp.array([0.2, -0.1, 0.3, 0.5, 0.4, -0.2])
    X, V = simulate(brick, V0, F_W, 2.0)
    momentum = spatial_wrench(X, brick.apply(V))
    assert_allclose(momentum, brick.apply(V0) + 2.0 * F_W, atol=1e-9)


def test_power_is_the_rate_of_kinetic_energy(bodies, twists, precision):
    V, F = twists, twists[::-1]

    def rate(G, V, F):
        return jax.jvp(G.kinetic_energy, (V,), (newton_euler_acceleration(G, V, F),))[1]

    errors = jax.vmap(rate)(bodies, V, F) - jax.vmap(power)(V, F)
    assert_allclose(errors, np.zeros(len(errors)), atol=2000 * precision.atol)


def test_free_body_of_mujoco(x64, oracle):
    model, data = oracle("""
        <mujoco>
          <option gravity="0 0 0"/>
          <worldbody><body pos="1 2 3" quat="0.5 0.1 -0.7 0.3"><freejoint/>
            <inertial pos="0.1 -0.2 0.3" quat="0.9 0.2 0.1 0.3" mass="1.5"
              diaginertia="0.2 0.5 0.6"/>
          </body></worldbody>
        </mujoco>""")
    data.qvel[:] = [0.4, -1.0, 0.3, 2.0, -1.5, 0.7]
    data.xfrc_applied[1] = [0.3, 0.2, -0.8, 0.5, -0.4, 0.1]
    mujoco.mj_forward(model, data)
    quat = jnp.asarray(data.xquat[1])
    principal = Pose(quat=jnp.asarray(model.body_iquat[1]), pos=jnp.asarray(model.body_ipos[1]))
    G = Inertia.from_principal(model.body_mass[1], principal, jnp.asarray(model.body_inertia[1]))
    X = Pose(quat=quat, pos=jnp.asarray(data.xpos[1]))
    # MuJoCo's qvel is the linear velocity in world axes, then the angular in body axes.
    w, v_W = jnp.asarray(data.qvel[3:]), jnp.asarray(data.qvel[:3])
    V = jnp.concatenate([w, X.inverse().replace(pos=jnp.zeros(3)).apply(v_W)])
    force, torque = jnp.asarray(data.xfrc_applied[1]).reshape(2, 3)
    at_com = Pose(quat=Pose.identity().quat, pos=jnp.asarray(data.xipos[1]))
    F = body_wrench(X, spatial_wrench(at_com, jnp.concatenate([torque, force])))
    dV = newton_euler_acceleration(G, V, F)
    linear = quat_rotate(quat, dV[3:] + jnp.cross(w, V[3:]))
    assert_allclose(data.qacc, jnp.concatenate([linear, dV[:3]]), atol=1e-12)


def test_spinning_about_a_principal_axis_is_steady():
    G = Inertia.from_principal(
        1.0,
        Pose(quat=quat_from_axis_angle(jnp.array([0.0, 0.0, 1.0]), 0.4), pos=jnp.zeros(3)),
        jnp.array([1.0, 2.0, 2.5]),
    )
    V = jnp.array([np.cos(0.4), np.sin(0.4), 0.0, 0.0, 0.0, 0.0])
    assert_allclose(newton_euler_acceleration(G, V, jnp.zeros(6)), np.zeros(6), atol=1e-6)
