"""Lagged friction: what slides neither hovers nor hops, and stops where Coulomb says."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit
from point_mass import TIMESTEP, compiled_step, point_mass, repeated

from jaxsim.constraint.laws.sap import STICTION
from jaxsim.solver import Disc


def test_stops_after_coulombs_distance_without_hovering():
    """From equilibrium at speed v a mass stops after `v^2 / 2 mu g`, and creeps under a push."""
    step = compiled_step(point_mass("lagged"))
    sunk = -2 * 10 / 1e6
    qpos, qvel, status = repeated(step, 120, [0, sunk], [2, 0])
    # A step moves by the velocity at its end, which is half a step too little.
    np.testing.assert_allclose(qpos[-1, 0] + TIMESTEP * 2 / 2, 2**2 / (2 * 0.5 * 10), rtol=1e-4)
    np.testing.assert_allclose(qpos[:, 1], sunk, rtol=1e-6)
    assert status.converged.all()
    _, qvel, _ = repeated(step, 30, [0, sunk], [0, 0], 1.0)
    np.testing.assert_allclose(qvel[-1, 0], STICTION * TIMESTEP / 2, rtol=1e-6)


@pytest.mark.parametrize("dim", [3, 6])
def test_force_is_the_closest_point_of_the_ellipse(dim):
    """`f = argmin |f + k friction^2 r|` in the metric of the regularisation, within the ellipse."""
    rng, n = np.random.default_rng(dim), 60
    friction = rng.uniform(0.1, 2, (n, dim - 1))
    k, normal = rng.uniform(0.5, 2, n), rng.uniform(0, 1, n) * (rng.random(n) > 0.1)
    D = np.concatenate([rng.uniform(0.5, 2, (n, 1)), k[:, None] * friction**2], axis=1)
    r = rng.normal(size=(n, dim))
    disc = Disc(jnp.zeros((n, dim)), *map(jnp.asarray, (D, friction, normal)))
    force = np.asarray(quick_jit(disc.force)(jnp.asarray(r)))
    scaled = -k[:, None] * friction * r[:, 1:]
    length = np.linalg.norm(scaled, axis=1, keepdims=True)
    expected = friction * scaled * np.minimum(1, normal[:, None] / length)
    np.testing.assert_allclose(force[:, 1:], expected, atol=1e-12)
    np.testing.assert_allclose(force[:, 0], -D[:, 0] * np.minimum(r[:, 0], 0), atol=1e-12)
