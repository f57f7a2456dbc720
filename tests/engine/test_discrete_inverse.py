"""The inverse of a step: no force is missing for the velocity that the step reaches."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.constraint.laws import Blur
from jaxsim.engine.discrete_inverse import missing_force

# A damped mass that slides, and another that rests, on a plane; a pendulum with a limit.
XML = """<mujoco><option timestep=".01"/><default><geom friction=".4"/></default><worldbody>
  <geom name="floor" type="plane" size="0 0 1"/>
  <body pos="0 0 .1"><joint name="x" type="slide" axis="1 0 0" damping="3"/>
    <joint type="slide" axis="0 0 1"/><geom name="ball" size=".1" mass="2"/></body>
  <body pos="1 0 .5"><joint axis="0 1 0" damping=".2" limited="true" range="-10 10"/>
    <geom pos="0 0 -.2" size=".05" mass="1" contype="0" conaffinity="0"/></body></worldbody>
  <actuator><motor joint="x" gear="5"/></actuator></mujoco>"""


@pytest.mark.parametrize("law", ["mujoco", "sap", "lagged"])
def test_nothing_is_missing_for_a_step(x64, law):
    model = jaxsim.load(XML, contact=law)
    state = jaxsim.make_state(model).replace(
        qpos=jnp.array([0.0, -1e-3, 0.2]), qvel=jnp.array([1.0, -0.1, 0.5])
    )
    ctrl, push = jnp.array([0.7]), jnp.array([0.3, -0.2, 0.1])
    blunt, sharp = (Blur(jnp.asarray(x), jnp.asarray(0.1 * x)) for x in (0.01, 0.0))

    @quick_jit
    def missing(state):
        after = jaxsim.step(model, state.replace(qfrc_applied=push), ctrl).qvel
        given = state.replace(qfrc_applied=push)
        forces = lambda blur: missing_force(model, given, ctrl, after, blur)  # noqa: E731
        pushed = missing_force(model, state, ctrl, after)
        return forces(None), forces(sharp), forces(blunt), pushed, jax.jacfwd(forces)(blunt)

    exact, unblurred, blurred, pushed, slope = missing(state)
    np.testing.assert_allclose(exact, 0, atol=1e-7)
    np.testing.assert_allclose(unblurred, exact, atol=1e-9)
    np.testing.assert_allclose(pushed, push, atol=1e-7)
    assert np.abs(blurred[:2]).min() > 1e-3, "blur changes normal forces and friction"
    assert np.abs(blurred[2]) < 1e-7
    assert np.isfinite(slope.length).all()
