"""Laws of contact: a toy one by the line that registers a law, and the table's error."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.constraint.laws import LAWS
from jaxsim.solver import Quadratic

BALL = """<mujoco><option timestep=".01"/><worldbody>
  <geom type="plane" size="0 0 1" condim="1"/>
  <body pos="0 0 -1"><freejoint/><geom size=".1" mass="3" condim="1"/></body>
</worldbody></mujoco>"""
DAMPING = 40.0


def damped(opt, contact):
    """Contact as a viscous fluid: a reference that only damps, as inert as the bodies."""
    active = contact.dist < contact.includemargin
    D = jnp.where(active, 1 / contact.inverse_weight, 0.0)
    aref = -DAMPING * contact.velocity
    return Quadratic(aref=aref, D=jnp.broadcast_to(D, aref.shape))


def test_a_toy_law_is_one_function_and_one_line(monkeypatch, x64):
    """A ball sinks through a viscous ground: minimising m (a + g)^2 + m (a + b v)^2 over a."""
    monkeypatch.setitem(LAWS, "damped", damped)
    model = jaxsim.load(BALL, contact="damped")
    steps, start = 60, jaxsim.make_state(model)
    run = quick_jit(lambda state: jaxsim.rollout(model, state, jnp.zeros((steps, 0))))
    _, states = run(start)
    shrink, terminal = 1 - 0.5 * DAMPING * 0.01, -9.81 / DAMPING
    expected = terminal * (1 - shrink ** np.arange(1, steps + 1))
    np.testing.assert_allclose(states.qvel[:, 2], expected, rtol=1e-10)
    np.testing.assert_allclose(states.qvel[:, [0, 1, 3, 4, 5]], 0, atol=1e-12)


def test_an_unknown_law_is_refused_with_the_known_ones():
    with pytest.raises(ValueError, match="contact must be one of mujoco, sap, .*got 'elastic'"):
        jaxsim.load(BALL, contact="elastic")
