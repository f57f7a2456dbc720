"""Geometry of one segment over a surface: closed forms, and derivatives at degenerate poses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

from jaxsim.arrays.norms import safe_norm
from jaxsim.dynamics.tendons.circle import around, through
from jaxsim.dynamics.tendons.wrapping import wrap_cylinder, wrap_sphere

SURFACES = {"sphere": wrap_sphere, "cylinder": wrap_cylinder}
SIDES = {"none": None, "outside": (0.0, 0.0, -0.3), "inside": (0.0, 0.0, 0.02)}


@pytest.fixture(autouse=True)
def float64(x64):
    """Geometry is checked in float64."""


def total(wrap, x0, x1, side):
    """Length from end to end."""
    w = wrap(x0, x1, jnp.zeros(3), jnp.eye(3), jnp.asarray(0.1), side)
    over = safe_norm(w.start - x0) + w.length + safe_norm(w.stop - x1)
    return jnp.where(w.touches, over, safe_norm(x1 - x0))


def test_half_a_turn_around_a_pulley():
    arc = around(jnp.array([-2.0, 1.0]), jnp.array([-3.0, -1.0]), 1.0, jnp.array([1.0, 0.0]))
    assert arc.touches
    np.testing.assert_allclose(arc.length, np.pi, rtol=1e-12)
    np.testing.assert_allclose(arc.start, [0, 1], atol=1e-12)
    np.testing.assert_allclose(arc.stop, [0, -1], atol=1e-12)


def test_a_straight_line_passes_by():
    assert not around(jnp.array([-2.0, 1.1]), jnp.array([2.0, 1.1]), 1.0, None).touches


def test_a_path_through_a_ring_is_the_shortest(rng):
    """No other point of the circle that both ends see makes the path shorter."""
    turns = np.linspace(0, 2 * np.pi, 20001)
    circle = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    compute = quick_jit(lambda p0, p1: through(p0, p1, jnp.asarray(1.0)))
    angles, distances = rng.uniform(0, 2 * np.pi, (40, 2)), rng.uniform(1.001, 4, (40, 2))
    ends = distances[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=2)
    touching = 0
    for p0, p1 in ends:
        arc = compute(p0, p1)
        touching += int(arc.touches)
        if arc.touches:
            length = lambda q: np.linalg.norm(q - p0, axis=-1) + np.linalg.norm(q - p1, axis=-1)  # noqa: B023, E731
            np.testing.assert_allclose(np.linalg.norm(arc.start), 1, rtol=1e-12)
            assert length(np.asarray(arc.start)) <= length(circle).min() + 1e-12
    assert touching > 10


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("surface", SURFACES)
def test_derivatives_are_finite_and_lengths_agree_with_differences(surface, side, rng):
    wrap, side = SURFACES[surface], SIDES[side]
    side = None if side is None else jnp.array(side)
    x0 = jnp.array([-0.3, 0.0, 0.1])
    # Begins to touch, is on the surface, at the centre, on one line with the centre, at x0.
    poses = [(0.3, 0, 0.1), (0.1, 0, 0), (0, 0, 0), (0.3, 0, -0.1), (-0.3, 0, 0.1)]
    poses += [(0.3, 0, 0.1 + d) for d in (1e-9, -1e-9)]
    poses += list(rng.uniform(-0.4, 0.4, (8, 3)))
    length = lambda x1: total(wrap, x0, x1, side)  # noqa: E731

    def derivatives(x1):
        h = 1e-6 * jnp.eye(3)
        difference = jax.vmap(lambda e: (length(x1 + e) - length(x1 - e)) / 2e-6)(h)
        return jax.grad(length)(x1), jax.hessian(length)(x1), difference

    gradient, hessian, difference = quick_jit(jax.vmap(derivatives))(jnp.array(poses))
    assert np.isfinite(gradient).all()
    assert np.isfinite(hessian).all()
    np.testing.assert_allclose(gradient[7:], difference[7:], atol=1e-7)
