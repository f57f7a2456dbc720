"""SAP contact: Drake's formulas on random rows, and its artefacts in closed form."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit
from point_mass import TIMESTEP, compiled_step, point_mass, repeated

from jaxsim.constraint.laws import ContactState, Material
from jaxsim.constraint.laws.sap import STICTION, contact_cost

MASS, GRAVITY = 2.0, 10.0


def drake(h, k, tau, w, mu, phi, v_before, v):
    """Cost and impulse of one contact at the velocity v (Castro et al. 2022, section 4)."""
    Rn = max(w / (4 * np.pi**2), 1 / (h * k * (h + tau)))
    Rt = STICTION * w
    y = -(v - np.array([-phi / (h + tau), 0, 0])) / np.array([Rn, Rt, Rt])
    yr, yn = np.linalg.norm(y[1:]), y[0]
    mu_hat, mu_tilde = mu * Rt / Rn, mu * np.sqrt(Rt / Rn)
    if yr <= mu * yn:
        impulse = y
    elif -mu_hat * yr < yn:
        normal = (yn + mu_hat * yr) / (1 + mu_tilde**2)
        impulse = normal * np.array([1, *(mu * y[1:] / yr)])
    else:
        impulse = np.zeros(3)
    return 0.5 * np.sum(np.array([Rn, Rt, Rt]) * impulse**2), impulse


def test_cost_and_impulse_are_drakes_on_random_rows():
    """In every zone, for springs that are soft and springs as hard as the time step allows."""
    rng, n, h = np.random.default_rng(0), 300, 0.01
    model = point_mass("sap")
    opt = model.opt.replace(timestep=jnp.asarray(h))
    k, tau, w = 10 ** rng.uniform(2, 7, n), rng.uniform(0, 0.02, n), 10 ** rng.uniform(-2, 2, n)
    mu, phi = rng.uniform(0.1, 1, n), rng.uniform(-0.01, 0, n)
    # Of one size: accelerations are differences of both, whose digits are those of the larger one.
    before, after = rng.normal(size=(2, n, 3)) * 10 ** rng.uniform(-4, 0, (n, 1))
    none = np.zeros((n, 2))
    contact = ContactState(
        dist=phi,
        includemargin=np.full(n, 10.0),
        rounding=np.zeros(n),
        velocity=before,
        inverse_weight=w,
        friction=np.tile(mu[:, None], 5),
        solref=none,
        solreffriction=none,
        solimp=np.zeros((n, 5)),
        material=Material(k, tau, np.zeros(n)),
    )

    def cost_and_force(contact):
        kind = jax.vmap(lambda c: contact_cost(opt, c))(contact)
        residual = (after - before) / h - kind.aref
        return kind.cost(residual), kind.force(residual)

    cost, force = quick_jit(cost_and_force)(jax.tree.map(jnp.asarray, contact))
    expected = [
        drake(h, *numbers) for numbers in zip(k, tau, w, mu, phi, before, after, strict=True)
    ]
    impulses = np.stack([impulse for _, impulse in expected])
    assert 5 < np.sum(impulses[:, 0] == 0) < n / 2
    scale = np.abs(impulses).max(axis=1, keepdims=True) + 1e-300
    np.testing.assert_allclose(h * force / scale, impulses / scale, atol=1e-12)
    np.testing.assert_allclose(h * h * cost, sum(c for c, _ in expected), rtol=1e-12)


def test_artefacts_of_sliding_and_sticking_in_closed_form():
    """What slides steadily hovers where `sap` says, and what sticks creeps as fast as it says."""
    k, mu, speed = 1e6, 0.5, 0.25
    model = point_mass("sap")
    step = compiled_step(model)
    for tau in (0.0, TIMESTEP):  # of both surfaces together
        each = jnp.full_like(model.geom_relaxation, tau / 2)
        Rn = max(1 / MASS / (4 * np.pi**2), 1 / (TIMESTEP * k * (TIMESTEP + tau)))
        weight = MASS * GRAVITY * TIMESTEP * (1 + mu**2 * STICTION / MASS / Rn) * Rn
        height = (TIMESTEP + tau) * (mu * speed - weight)
        assert height > 1e-4
        push, changed = mu * MASS * GRAVITY, model.replace(geom_relaxation=each)
        state, _ = step([0, height], [speed, 0], push, model=changed)
        np.testing.assert_allclose(state.qvel, [speed, 0], atol=1e-12)
    _, qvel, _ = repeated(step, 50, [0, 0], [0, 0], 1.0)
    np.testing.assert_allclose(qvel[-1, 0], STICTION * TIMESTEP / MASS, rtol=1e-6)


@pytest.mark.parametrize("law", ["sap", "lagged"])
def test_float32_follows_float64(law, x32):
    step = compiled_step(point_mass(law))
    qpos, qvel, status = repeated(step, 60, [0, 0], [1, 0])
    with jax.enable_x64(True):
        expected, _, _ = repeated(compiled_step(point_mass(law)), 60, [0, 0], [1, 0])
    np.testing.assert_allclose(qpos, expected, atol=1e-4)
    assert status.finite.all()
