"""Derivatives of soft contact at rest, under a push and after a landing, with known answers."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from oracle import quick_jit

from jaxsim import load, make_state, step

G = 9.81
# Nothing turns, so that a ball is a block with one contact.
BLOCK = """
<mujoco>
  <option timestep=".001" cone="elliptic" tolerance="0"/>
  <default><geom friction=".3 0 0" condim="3"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body><joint name="x" type="slide" axis="1 0 0"/>
      <joint type="slide" axis="0 0 1"/>
      <geom size=".1" mass="2" contype="0"/></body>
  </worldbody>
  <actuator><motor joint="x"/></actuator>
</mujoco>
"""


@pytest.fixture(autouse=True)
def float64(x64):
    """Creep is small."""


@pytest.fixture
def motion():
    """The end of a motion and its Jacobian, with respect to start, force, solref, d, g and mass."""
    model = load(BLOCK)

    def end(start, force, solref, d, g, mass, steps):
        opt = model.opt.replace(gravity=jnp.array([0, 0, -1.0]) * g)
        changed = model.replace(
            opt=opt,
            geom_solref=jnp.tile(solref, (2, 1)),
            geom_solimp=jnp.tile(jnp.array([0, 0, 0.001, 0.5, 2]).at[:2].set(d), (2, 1)),
            body_mass=model.body_mass.at[1].set(mass),
            body_invweight0=model.body_invweight0.at[1, 0].set(1 / mass),
        )
        state = make_state(model).replace(qpos=start[:2], qvel=start[2:])
        ctrl = force * jnp.ones(1)
        state = lax.fori_loop(0, steps, lambda _, s: step(changed, s, ctrl), state)
        return state.qpos

    return quick_jit(lambda *x: (end(*x), jax.jacfwd(end, range(6))(*x)))


def test_rest_creep_and_slide(motion):
    """Cases G5, G6 and G13b."""
    tau, zeta, d, m = 0.02, 1.0, 0.95, 2.0
    depth = (1 - d) * G * tau**2 * zeta**2
    rest = np.array([0, 0.1 - depth, 0, 0])
    inputs = np.array([tau, zeta]), d, G, m
    (_, z), slopes = motion(rest, 0.0, *inputs, 1000)
    np.testing.assert_allclose(0.1 - z, depth, rtol=1e-6)
    _, _, by_solref, by_d, by_g, by_mass = (-np.asarray(s)[1] for s in slopes)
    np.testing.assert_allclose(by_solref, [0.01962, 3.924e-4], rtol=1e-4)
    np.testing.assert_allclose([by_d, by_g], [-3.924e-3, 2e-5], rtol=1e-4)
    assert abs(by_mass) < 1e-9
    # It slides to the speed of its creep at once, (1 - d) tau F / 2 m.
    (x, _), slopes = motion(rest, 1.0, *inputs, 1000)
    creep = (1 - d) * tau / (2 * m)
    np.testing.assert_allclose([x, np.asarray(slopes[1])[0]], creep, rtol=0.02)
    # It falls by 0.2, loses mu v of its speed on landing, and slides on.
    (x, _), slopes = motion(np.array([0, 0.3, 3, 0]), 0.0, *inputs, 800)
    np.testing.assert_allclose(x, 1.51824, rtol=5e-3)
    np.testing.assert_allclose(np.asarray(slopes[0])[0, [1, 2]], [0.3, 0.8], rtol=0.02)
