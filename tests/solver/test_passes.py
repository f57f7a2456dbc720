"""Exact Coulomb friction: the passes of Newton's method against projected Gauss-Seidel."""

import jax
import jax.numpy as jnp
import numpy as np
from oracle import quick_jit
from random_contacts import CONTACTS, SETS, after_impact, is_wedged, random_bodies


def onto_cone(f, mu):
    """The closest points of friction cones."""
    normal, slip = f[:, :1], f[:, 1:]
    length = np.linalg.norm(slip, axis=1, keepdims=True)
    edge = np.maximum(normal + mu * length, 0) / (1 + mu**2)
    on_edge = np.concatenate([edge, mu * edge * slip / np.where(length > 0, length, 1)], axis=1)
    return np.where(length <= mu * normal, f, on_edge)


def gauss_seidel(mass, J, v, mu, sweeps=4000):
    """Velocities after plastic impacts, by one contact after the other until nothing changes.

    In these variables the law of Coulomb and Signorini is `f = P(f - k (u + mu |u_t| n))` for every
    k > 0, with P the projection onto the cone.
    """
    v, impulse = v.copy(), np.zeros((SETS, CONTACTS, 3))
    response = np.swapaxes(J, 2, 3) / mass[:, None, :, None]
    k = 1 / np.einsum("scij,scji->sc", J, response)[:, :, None]
    for _ in range(sweeps):
        before = v.copy()
        for i in range(CONTACTS):
            u = np.einsum("sij,sj->si", J[:, i], v)
            u[:, 0] += mu[:, 0] * np.linalg.norm(u[:, 1:], axis=1)
            change = onto_cone(impulse[:, i] - k[:, i] * u, mu) - impulse[:, i]
            impulse[:, i] += change
            v += np.einsum("sij,sj->si", response[:, i], change)
        if np.abs(v - before).max() < 1e-13:
            break
    return v


def test_random_impacts_are_those_of_gauss_seidel_and_create_no_energy(x64):
    rng = np.random.default_rng(0)
    mass, J = random_bodies(rng)
    v, mu = rng.normal(size=(SETS, 12)), rng.uniform(0.1, 0.6, (SETS, 1))
    after, converged = quick_jit(jax.vmap(after_impact))(*map(jnp.asarray, (mass, J, v, mu[:, 0])))
    after, converged = np.asarray(after), np.asarray(converged)
    wedged = is_wedged(mass, J, mu)
    assert converged[~wedged].mean() > 0.99
    judged = converged & ~wedged
    assert judged.sum() > 500
    expected = gauss_seidel(mass, J, v, mu)
    np.testing.assert_allclose(after[judged], expected[judged], atol=1e-7)
    energy = lambda v: np.sum(mass * v * v, axis=1)[judged]  # noqa: E731
    assert (energy(after) <= energy(v) * (1 + 1e-10)).all()
    assert (energy(after) < 0.99 * energy(v)).mean() > 0.5
