"""Derivatives of smooth forces and of whole steps against central differences."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit
from random_models import random_states
from smooth_models import FLUID, arm, kitchen_sink
from smooth_stages import step

from jaxsim.io import load
from jaxsim.joints.coordinates import difference_pos, integrate_pos
from jaxsim.model import make_state

STEP = 1e-6

# One body in a fluid, on springs without any deflection: all at its singular point when at rest.
SINGULAR = f"""
<mujoco><option {FLUID.replace("1 2 3", "0 0 0")}/>
<default><geom contype="0" conaffinity="0"/></default><worldbody>
<body><joint name="free" type="free" stiffness="2 1 1" damping=".5 .2 .1"/>
<geom type="box" size=".1 .2 .3"/><body><joint name="ball" type="ball" stiffness="1 .5 .2"
damping=".1 .1 .1"/><geom size=".1" pos=".2 0 0"/></body></body></worldbody>
<actuator><position joint="ball" gear="1 .2 .3" kp="3"/></actuator></mujoco>
"""


@pytest.mark.parametrize(
    ("xml", "at_rest"),
    [
        (SINGULAR, True),
        (arm("RK4"), False),
        pytest.param(arm("implicitfast"), False, marks=pytest.mark.slow),
        pytest.param(kitchen_sink(), False, marks=pytest.mark.slow),
        pytest.param(kitchen_sink("implicitfast", FLUID), False, marks=pytest.mark.slow),
        pytest.param(kitchen_sink("implicit", FLUID), False, marks=pytest.mark.slow),
    ],
)
def test_step_in_both_modes(xml, at_rest):
    """Rows of the tangent space: a step is a function of position, velocity, act and ctrl."""
    mj = mujoco.MjModel.from_xml_string(xml)
    model = load(mj)
    qpos, qvel = (x[0] for x in random_states(mj, seed=2, n=1))
    if at_rest:
        qpos, qvel = mj.qpos0, 0 * qvel
    sizes = np.cumsum([mj.nv, mj.nv, mj.na])

    def f(x):
        dq, dv, act, ctrl = jnp.split(x, sizes)
        state = make_state(model)
        start = integrate_pos(model, jnp.asarray(qpos), dq, 1.0)
        state = state.replace(qpos=start, qvel=qvel + dv, act=0.4 + act)
        after = step(model, state, 0.2 + ctrl)
        moved = difference_pos(model, jnp.asarray(qpos), after.qpos)
        return jnp.concatenate([moved, after.qvel, after.act])

    x = jnp.zeros(2 * mj.nv + mj.na + mj.nu)

    @quick_jit
    def derivatives(x):
        probes = STEP * jnp.eye(len(x), dtype=x.dtype)
        up, down = jnp.split(jax.vmap(f)(x[None] + jnp.concatenate([probes, -probes])), 2)
        return jax.jacfwd(f)(x), jax.jacrev(f)(x), (up - down).T / (2 * STEP)

    forward, reverse, numeric = derivatives(x)
    np.testing.assert_allclose(forward, numeric, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9, atol=1e-9)
