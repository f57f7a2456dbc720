"""Muscle curves against MuJoCo's own functions, and their derivatives at the knots."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxsim.forces.muscle import (
    active_force_length,
    force_velocity,
    muscle_activation_rate,
    muscle_bias,
    muscle_gain,
)

# range (2), force, scale, lmin, lmax, vmax, fpmax, fvmax
GIVEN = np.array([0.75, 1.05, 12.0, 200, 0.5, 1.6, 1.5, 1.3, 1.2, 0])
SCALED = np.array([0.75, 1.05, -1.0, 200, 0.5, 1.6, 1.5, 1.3, 1.2, 0])
SPAN, ACC0 = np.array([0.2, 0.6]), 3.0
LMIN, LMAX, FVMAX = 0.5, 1.6, 1.2
LENGTH_KNOTS = [LMIN, (LMIN + 1) / 2, 1.0, (1 + LMAX) / 2, LMAX]
VELOCITY_KNOTS = [-1.0, 0.0, FVMAX - 1]


@pytest.mark.parametrize("prm", [GIVEN, SCALED])
def test_forces_are_those_of_mujoco(prm):
    length = np.linspace(-0.4, 1.8, 23)
    velocity = np.linspace(-3, 3, 23)
    gain = jax.vmap(lambda x, v: muscle_gain(x, v, SPAN, ACC0, jnp.asarray(prm)))(length, velocity)
    bias = jax.vmap(lambda x: muscle_bias(x, SPAN, ACC0, jnp.asarray(prm)))(length)
    for i in range(len(length)):
        expected = mujoco.mju_muscleGain(length[i], velocity[i], SPAN, ACC0, prm[:9])
        np.testing.assert_allclose(gain[i], expected, rtol=1e-12, atol=1e-12)
        expected = mujoco.mju_muscleBias(length[i], SPAN, ACC0, prm[:9])
        np.testing.assert_allclose(bias[i], expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("width", [0.0, 0.4])
def test_activation_is_that_of_mujoco(width):
    prm = np.array([0.01, 0.04, width, 0, 0, 0, 0, 0, 0, 0])
    act, ctrl = (
        x.ravel() for x in np.meshgrid(np.linspace(-0.2, 1.2, 7), np.linspace(-0.5, 1.5, 9))
    )
    rate = jax.vmap(lambda u, a: muscle_activation_rate(u, a, jnp.asarray(prm)))(ctrl, act)
    expected = [mujoco.mju_muscleDynamics(u, a, prm[:3]) for u, a in zip(ctrl, act, strict=True)]
    np.testing.assert_allclose(rate, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    ("curve", "knots"),
    [
        (lambda x: active_force_length(x, LMIN, LMAX), LENGTH_KNOTS[1:4]),
        (lambda v: force_velocity(v, FVMAX), VELOCITY_KNOTS),
        (
            lambda x: muscle_bias(x, jnp.asarray(SPAN), ACC0, jnp.asarray(GIVEN)),
            [0.2 + 0.25 * 0.4 / 0.3],
        ),
    ],
)
def test_curves_are_smooth_at_their_knots(curve, knots):
    for x in knots:
        slope = (curve(x + 1e-6) - curve(x - 1e-6)) / 2e-6
        for derivative in (jax.grad, jax.jacfwd):
            np.testing.assert_allclose(derivative(curve)(x), slope, atol=1e-4)


def test_the_force_length_curve_ends_at_zero():
    ends = jnp.asarray([LMIN, LMAX])
    np.testing.assert_allclose(jax.vmap(lambda x: active_force_length(x, LMIN, LMAX))(ends), 0)
    assert float(active_force_length(1.0, LMIN, LMAX)) == 1.0


def test_activation_has_finite_derivatives_everywhere():
    for width in (0.0, 0.3):
        prm = jnp.asarray([0.01, 0.04, width, 0, 0, 0, 0, 0, 0, 0])
        for u, a in ((0.0, 0.0), (1.0, 1.0), (0.5, 0.5), (0.35, 0.5), (0.65, 0.5)):
            slopes = jax.grad(muscle_activation_rate, argnums=(0, 1, 2))(u, a, prm)
            assert all(np.isfinite(s).all() for s in slopes)
