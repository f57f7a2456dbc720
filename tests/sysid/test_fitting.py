"""Identification finds the numbers that data were made with, and says which it cannot find."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest
from motions import recorded

import jaxsim
from jaxsim.sysid import Parameter, Recording, fit
from jaxsim.sysid.inertia import from_log_cholesky, to_log_cholesky

CART = """
<mujoco><option timestep="0.01" gravity="0 0 0"/><worldbody><body name="cart">
  <joint name="x" type="slide" axis="1 0 0" damping="1.5"/><geom size=".1" mass="2"/>
</body></worldbody><actuator><motor joint="x"/></actuator></mujoco>
"""
BOX = """
<mujoco><option timestep="0.004" iterations="20" ls_iterations="20" cone="elliptic"/>
<default><geom solimp="0 .95 .002" friction=".4 .005 .0001"/></default>
<worldbody><geom type="plane" size="0 0 1" friction=".01 .005 .0001"/>
  <body name="box" pos="0 0 .06"><joint name="x" type="slide" axis="1 0 0" damping=".3"/>
    <joint name="z" type="slide" axis="0 0 1" damping=".3"/>
    <joint name="turn" axis="0 1 0" damping=".3"/>
    <geom name="box" type="box" size=".12 .09 .06" mass="1"/></body>
</worldbody><actuator><motor joint="x"/></actuator></mujoco>
"""
NOISE = (1e-3, 5e-3)


@pytest.fixture(autouse=True)
def float64(x64):
    """Normal equations square the condition."""


def carts(force, rng):
    model = jaxsim.load(CART)
    ctrl = force * np.sign(rng.normal(size=(3, 10, 1))).repeat(10, axis=1)
    return recorded(model, rng.normal(size=(3, 1)), 2 * rng.normal(size=(3, 1)), ctrl, rng, NOISE)


def wrong_cart():
    model = jaxsim.load(CART)
    return jaxsim.set_const(
        model.replace(body_mass=model.body_mass * 3, dof_damping=model.dof_damping / 2)
    )


@pytest.mark.slow
def test_mass_and_damping_of_a_cart(rng):
    found = fit(
        wrong_cart(), carts(3.0, rng), ["body_mass[cart]", "dof_damping[x]"], noise=NOISE, window=20
    )
    assert found.converged
    assert found.undetermined == []
    errors = np.log(found.values / [2, 1.5])
    assert (np.abs(errors) < 4 * found.std).all()
    assert (found.std < 0.02).all()
    # About 600 numbers are measured: their root mean square is known to 3 per cent.
    np.testing.assert_allclose(found.misfit, 1, atol=0.1)
    np.testing.assert_allclose(found.model.body_mass[1], found.values[0])
    assert "body_mass[cart]" in str(found)
    assert found.predicted_qpos.shape == found.windows.qpos.shape


def test_what_cannot_be_told_apart_is_named(rng):
    """Without forces only the ratio of damping to mass shows; a prior decides the rest."""
    names = [Parameter("body_mass[cart]", prior=0.1), "dof_damping[x]"]
    found = fit(wrong_cart(), carts(0.0, rng), names, noise=NOISE, window=20)
    (unknown,) = found.undetermined
    np.testing.assert_allclose(np.abs(unknown.weights), np.sqrt(0.5), atol=1e-2)
    assert "0.71 body_mass[cart]" in unknown.text
    assert "0.71 dof_damping[x]" in unknown.text
    np.testing.assert_allclose(found.values[1] / found.values[0], 0.75, rtol=0.02)
    np.testing.assert_allclose(found.values[0], 6, rtol=1e-2)  # the prior's centre
    np.testing.assert_allclose(found.std, 0.1, rtol=0.05)


@pytest.mark.slow
def test_many_starts_by_gradients(rng):
    """A transformation of optax instead of least squares, on three first guesses at once."""
    found = fit(
        jaxsim.load(CART),
        carts(3.0, rng),
        ["body_mass[cart]", "dof_damping[x]"],
        noise=NOISE,
        window=None,
        starts=3,
        iterations=150,
        refine=False,
        method=optax.adam(0.03),
    )
    assert found.costs.shape == (3,)
    np.testing.assert_allclose(np.exp(found.coordinates), [[2, 1.5]] * 3, rtol=0.03)


@pytest.mark.slow
def test_a_tossed_and_sliding_box(rng):
    """Mass, friction and damping to 2 per cent, from wherever the search begins."""
    truth = jaxsim.load(BOX)
    height, turn = 0.02 + 0.05 * rng.random(5), 0.3 * rng.normal(size=5)
    qpos = np.stack([np.zeros(5), height, turn], axis=1)
    qvel = rng.normal(size=(5, 3)) * [1.5, 0, 2]
    ctrl = 6 * rng.normal(size=(5, 6, 1)).repeat(25, axis=1)
    noise = (2e-4, 5e-3)
    data = recorded(truth, qpos, qvel, ctrl, rng, noise)
    wrong = truth.replace(
        body_mass=1.4 * truth.body_mass,
        body_inertia=1.4 * truth.body_inertia,
        geom_friction=truth.geom_friction.at[1, 0].set(0.6),
        dof_damping=jnp.full(3, 0.6),
    )
    damping = Parameter("dof_damping[*]", tied=True)
    found = fit(
        jaxsim.set_const(wrong),
        data,
        ["mass[box]", "geom_friction[box, 0]", damping],
        noise=noise,
        starts=64,
        iterations=40,
    )
    np.testing.assert_allclose(np.exp(found.coordinates), [[1, 0.4, 0.3]] * 64, rtol=0.02)


@pytest.mark.slow
def test_inertias_of_an_arm_with_seven_joints(rng):
    """Ten numbers of each link: mass matrix and weight come within 1 per cent."""
    model = jaxsim.load("arm")
    model = jaxsim.set_const(model.replace(dof_armature=jnp.full(7, 0.01)))
    truth, spread = model, np.array([0.15, *[0.2] * 3, *[0.1] * 6])
    for body in range(1, 8):
        x, length = to_log_cholesky(truth, body)
        truth = from_log_cholesky(truth, body, x + spread * rng.normal(size=10), length)
    truth, noise = jaxsim.set_const(truth), (1e-4, 1e-3)
    links = [Parameter(f"inertia[link{i}]", prior=0.3) for i in range(7)]
    data = [every(5, r) for r in recorded(truth, *excitation(rng), rng, noise)]
    found = fit(model, data, links, noise=noise, substeps=5, window=20, iterations=80)
    assert len(found.undetermined) > 20, "only sums of neighbours' inertias show"

    def does(model, qpos):
        zero = jnp.zeros(7)
        return jaxsim.mass_matrix(model, qpos), jaxsim.inverse_dynamics(model, qpos, zero, zero)

    poses = jnp.asarray(rng.uniform(-1.5, 1.5, size=(50, 7)))
    (M, weight), (true_M, true_weight) = (
        jax.tree.map(np.asarray, jax.vmap(does, (None, 0))(m, poses)) for m in (found.model, truth)
    )
    inertia = np.diagonal(true_M - np.diag(truth.dof_armature), axis1=1, axis2=2)
    assert np.all(np.abs(np.diagonal(M - true_M, axis1=1, axis2=2)) < 0.01 * inertia)
    assert np.all(np.abs(weight - true_weight) < 0.01 * np.abs(true_weight).max(0) + 1e-9)


def excitation(rng):
    """Five motions of four seconds: references of four frequencies, held for 20 ms each."""
    time = 0.02 * np.arange(200)[None, :, None]
    waves = [
        0.25 * rng.normal(size=(5, 1, 7)) * np.sin(2 * np.pi * (f * time + rng.random((5, 1, 7))))
        for f in (0.3, 0.7, 1.3, 2.1)
    ]
    return np.zeros((5, 7)), np.zeros((5, 7)), sum(waves).repeat(5, axis=1)


def every(n, recording):
    """The recording with each n-th sample."""
    return Recording(recording.qpos[::n], recording.ctrl[::n], recording.qvel[::n])
