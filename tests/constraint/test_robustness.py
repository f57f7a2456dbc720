"""States that no simulation should reach, but some do: finite numbers, and a status that tells."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.engine import forward, step
from jaxsim.io import load
from jaxsim.model import make_state

# A light body between heavy ones, all in contact, beside a pendulum at its stop.
SCENE = """
<mujoco>
  <option timestep="0.004" cone="{cone}"/>
  <default><geom condim="4"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body pos="0 0 .1"><freejoint/><geom size=".1" mass="1e3"/></body>
    <body pos=".12 0 .23"><freejoint/><geom size=".08" mass="1e-4"/></body>
    <body pos=".25 0 .1"><freejoint/>
      <geom type="capsule" size=".1 .1" mass="1e3" condim="6"/></body>
    <body pos="0 3 1"><joint name="stop" axis="0 1 0" limited="true" range="-20 20"
        frictionloss="1"/>
      <geom type="capsule" fromto="0 0 0 .4 0 0" size=".05"/></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize(
    ("cone", "double"),
    [("elliptic", False), pytest.param("pyramidal", True, marks=pytest.mark.slow)],
)
def test_extreme_states_stay_finite(cone, double):
    with jax.enable_x64(double):
        model = load(SCENE.format(cone=cone))
        states, names = _extremes(model)

        def both(state):
            return forward(model, state), step(model, step(model, state))

        out, after = quick_jit(jax.vmap(both))(states)
        jaxsim.check(out)
        jaxsim.check(after)
        for leaf in jax.tree.leaves((out, after)):
            assert np.isfinite(leaf).all()
        assert (out.status.iterations <= model.opt.iterations).all()
        assert (out.contact.force[:, :, 0] >= 0).all()
        # What is deep in the floor or beyond its stop is pushed back.
        assert out.qacc[names.index("deep"), 2] > 0
        assert out.qacc[names.index("beyond"), -1] < 0


def _extremes(model):
    """Deep penetration, a limit violated by one radian, high speeds, and all of it at once."""
    rest = make_state(model)
    deep = rest.replace(qpos=rest.qpos.at[np.array([2, 9, 16])].add(-3.0))
    beyond = rest.replace(qpos=rest.qpos.at[-1].set(1 + np.deg2rad(20)))
    spin = jnp.asarray(np.random.default_rng(0).choice([-1e3, 1e3], model.nv), rest.qvel.dtype)
    fast = rest.replace(qvel=spin)
    worst = beyond.replace(qpos=beyond.qpos.at[:21].set(deep.qpos[:21]), qvel=spin)
    same = rest.replace(qpos=rest.qpos.at[7:10].set(rest.qpos[:3]))
    states = {"rest": rest, "deep": deep, "beyond": beyond}
    states |= {"fast": fast, "worst": worst, "same": same}
    return jax.tree.map(lambda *x: jnp.stack(x), *states.values()), list(states)
