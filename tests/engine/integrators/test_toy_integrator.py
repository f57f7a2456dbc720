"""A toy integrator is one function and one line in the table."""

import jax.numpy as jnp
import numpy as np
from oracle import quick_jit

import jaxsim
from jaxsim.engine.integrators import INTEGRATORS, Step
from jaxsim.engine.integrators.advance import advance
from jaxsim.engine.status import Status

OSCILLATOR = """<mujoco><option timestep=".01" gravity="0 0 0"/><worldbody>
  <body><joint type="slide" stiffness="4"/><geom size=".1" mass="1"/></body>
</worldbody></mujoco>"""


def explicit_euler(model, state, evaluate):
    """The old velocity moves the positions."""
    now = evaluate(state)
    acting = now.actuation
    rates = acting.act_dot, acting.actuator_length
    after = advance(model, state, now.qacc, *rates, qvel=state.qvel)
    return Step(after, state, now.qacc, Status.of(now.constrained))


def test_a_toy_integrator_is_one_function_and_one_line(monkeypatch, x64):
    """Explicit Euler of `x'' = -4 x` gains energy: by the factor 1 + 4 h^2 each step."""
    monkeypatch.setitem(INTEGRATORS, 100, explicit_euler)
    model = jaxsim.load(OSCILLATOR)
    model = model.replace(opt=model.opt.replace(integrator=100))
    state = jaxsim.make_state(model).replace(qpos=jnp.asarray([0.5]), qvel=jnp.asarray([1.0]))
    run = quick_jit(lambda state: jaxsim.rollout(model, state, jnp.zeros((50, 0))))
    _, states = run(state)
    energy = 0.5 * states.qvel[:, 0] ** 2 + 2 * states.qpos[:, 0] ** 2
    expected = (1 + 4 * 0.01**2) ** np.arange(1, 51)
    np.testing.assert_allclose(energy, expected, rtol=1e-12)
