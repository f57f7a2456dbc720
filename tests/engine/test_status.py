"""How solves went: of one step, of the stages of Runge-Kutta, of rollouts and of batches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.constraint import operators

# Two balls on top of each other, which couple, and one beside them; each may touch the floor.
TOWER = """<mujoco><option integrator="{}"/><worldbody>
  <geom type="plane" size="9 9 1"/>
  <body pos="0 0 .099"><joint type="slide" axis="0 0 1"/><geom size=".1" condim="1"/></body>
  <body pos="0 0 .297"><joint type="slide" axis="0 0 1"/><geom size=".1" condim="1"/></body>
  <body pos="5 0 .099"><joint type="slide" axis="0 0 1"/><geom size=".1" condim="1"/></body>
</worldbody></mujoco>"""
STEPS = 4


def tower(integrator="Euler", **options):
    model = jaxsim.load(TOWER.format(integrator), **options)
    return model, jaxsim.make_state(model), jnp.zeros((STEPS, 0))


def test_a_rollout_has_the_statuses_of_its_steps_together():
    model, start, ctrls = tower()

    @quick_jit
    def both(state):
        final, _, total = jaxsim.rollout(model, state, ctrls, status=True)
        plain, _ = jaxsim.rollout(model, state, ctrls)
        alone = []
        for ctrl in ctrls:
            state, status = jaxsim.step_with_status(model, state, ctrl)
            alone.append(status)
        return final, plain, state, total, jax.tree.map(lambda *x: jnp.stack(x), *alone)

    final, plain, stepped, total, alone = both(start)
    np.testing.assert_allclose(final.qvel, stepped.qvel, rtol=1e-6)
    np.testing.assert_array_equal(final.qvel, plain.qvel)
    assert total.iterations == alone.iterations.sum() > 0
    assert total.residual == pytest.approx(alone.residual.max())
    assert total.converged
    assert total.finite
    assert total.contact_overflow == total.cg_iterations == 0
    jaxsim.check(total)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_lost_contacts_and_bad_numbers_show_in_each_environment(integrator):
    model, start, ctrls = tower(integrator, max_contacts=1)
    states = jax.tree.map(lambda x: jnp.stack([x, x, x]), start)
    push = states.qfrc_applied.at[1, 0].set(jnp.nan)
    high = states.qpos.at[2].add(jnp.asarray([1.0, 2.0, 1.0]))
    states = states.replace(qfrc_applied=push, qpos=high)
    found, status = jaxsim.batch_rollout(
        model, states, jnp.broadcast_to(ctrls[None], (3, STEPS, 0)), status=True
    )
    np.testing.assert_array_equal(np.isfinite(found.qvel).all(1), [True, False, True])
    np.testing.assert_array_equal(status.finite, [True, False, True])
    assert status.contact_overflow[0] == 1
    assert status.contact_overflow[2] == 0
    with pytest.raises(jaxsim.SimulationError, match="found no slot in 1 of 3|in 2 of 3"):
        jaxsim.check(status)


@pytest.mark.parametrize(("allowed", "enough"), [(1, False), (20, True)])
def test_conjugate_gradients_that_run_out_are_not_silent(monkeypatch, allowed, enough):
    monkeypatch.setattr(operators, "_CG_ITERATIONS", allowed)
    model, start, _ = tower(hessian="iterative")
    _, status = quick_jit(lambda s: jaxsim.step_with_status(model, s))(start)
    assert status.cg_iterations >= status.iterations > 0
    assert bool(status.cg_converged) == enough
