"""`check`: what compiled code reports as data becomes a message."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.engine import Status, forward
from jaxsim.engine.checking import SimulationError
from jaxsim.io import load
from jaxsim.model import make_state

# Four balls that all touch the floor.
BALLS = "".join(
    f'<body pos="{x} 0 .09"><joint type="slide" axis="0 0 1"/><geom size=".1" contype="0"/></body>'
    for x in range(4)
)
FLOOR = f"<mujoco><worldbody><geom type='plane' size='9 9 1'/>{BALLS}</worldbody></mujoco>"


def status(**changes):
    fields = {
        "iterations": jnp.zeros(3, int),
        "converged": jnp.ones(3, bool),
        "cg_iterations": jnp.zeros(3, int),
        "cg_converged": jnp.ones(3, bool),
        "residual": jnp.zeros(3),
        "finite": jnp.ones(3, bool),
        "passes": jnp.zeros(3, int),
        "rigid_residual": jnp.zeros(3),
        "contact_overflow": jnp.zeros(3, int),
    }
    return Status(**fields | changes)


def test_nothing_is_said_when_all_is_well(bundled):
    model = load(bundled("pendulum"))
    state = make_state(model)
    jaxsim.check(state)
    jaxsim.check(jax.tree.map(lambda x: jnp.stack([x, x]), state))
    jaxsim.check(status())


def test_states_that_are_not_finite_are_counted(bundled):
    state = make_state(load(bundled("pendulum")))
    batch = jax.tree.map(lambda x: jnp.stack([x] * 5), state)
    bad = batch.replace(qvel=batch.qvel.at[3, 0].set(jnp.inf), qpos=batch.qpos.at[1].set(jnp.nan))
    with pytest.raises(SimulationError, match="2 of 5 environments .* smaller timestep"):
        jaxsim.check(bad)
    with pytest.raises(SimulationError, match="1 of 1 environments"):
        jaxsim.check(jax.tree.map(lambda x: x[3], bad))


def test_a_status_reports_numbers_that_are_not_finite():
    with pytest.raises(SimulationError, match="1 of 3 .* numbers that are not finite"):
        jaxsim.check(status(finite=jnp.array([True, False, True])))


def test_conjugate_gradients_that_ran_out_are_reported_but_newton_steps_are_not():
    jaxsim.check(status(converged=jnp.array([True, False, True])))
    with pytest.raises(SimulationError, match="gradients ran out .* in 2 of 3 .*hessian='dense'"):
        jaxsim.check(status(cg_converged=jnp.array([True, False, False])))


def test_lost_contacts_are_counted():
    lost = status(contact_overflow=jnp.array([0, 2, 5]))
    with pytest.raises(SimulationError, match="up to 5 contacts .* in 2 of 3 .*max_contacts"):
        jaxsim.check(lost)


def test_other_things_are_refused():
    with pytest.raises(TypeError, match="State, a Forward or a Status, got ndarray"):
        jaxsim.check(np.zeros(3))


@pytest.mark.parametrize("option", ["max_contacts", "max_geom_pairs"])
def test_too_few_slots_overflow(option):
    few = load(FLOOR, **{option: 3})
    out = quick_jit(forward)(few, make_state(few))
    assert out.status.contact_overflow == 1
    assert out.contact.active.sum() == 3
    with pytest.raises(SimulationError, match="up to 1 contacts found no slot"):
        jaxsim.check(out)


def test_enough_slots_do_not_overflow():
    enough = load(FLOOR, max_contacts=4)
    out = quick_jit(forward)(enough, make_state(enough))
    jaxsim.check(out)
    assert out.contact.active.all()
    # Each ball weighs the same and pushes the same.
    np.testing.assert_allclose(out.contact.force[:, 0], out.contact.force[0, 0], rtol=1e-5)
