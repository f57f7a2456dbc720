"""MuJoCo's noslip solver, at its fixed point: agreement, no creep, derivatives in both modes."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from instants import converging, forward_all, rollout
from oracle import assert_close, quick_jit
from scenes import PILE

import jaxsim

# A finger with dry friction presses a ball on the floor. Few contacts: sweeps converge quickly.
FINGER = """
<mujoco>
  <option timestep="0.002" gravity="1 0 -9.81"/>
  <default><geom friction=".6 .01 .002"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body pos="0 0 .098"><freejoint/><geom size=".1" mass="1"/></body>
    <body pos="-.25 0 .42"><joint axis="0 1 0" frictionloss=".3"/>
      <geom type="capsule" fromto="0 0 0 .25 0 0" size=".02" mass=".3" contype="0" conaffinity="0"/>
      <body pos=".25 0 0"><joint axis="0 1 0" frictionloss=".2"/>
        <geom type="capsule" fromto="0 0 0 .01 0 -.2" size=".025" mass=".2"/></body></body>
  </worldbody>
</mujoco>
"""

# A point mass on a slope, friction above the tangent of 15 degrees.
SLOPE = """
<mujoco>
  <option timestep="0.002" gravity="2.539 0 -9.476" cone="elliptic" {}/>
  <worldbody>
    <geom type="plane" size="0 0 1" friction=".4"/>
    <body pos="0 0 .1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
      <geom size=".1" mass="2" friction=".4"/></body>
  </worldbody>
  <actuator><motor joint="x"/></actuator>
</mujoco>
""".replace('<joint type="slide" axis="1', '<joint name="x" type="slide" axis="1')


def swept(mj: mujoco.MjModel) -> mujoco.MjModel:
    """With so many sweeps that they converge."""
    mj.opt.noslip_iterations, mj.opt.noslip_tolerance = 5000, 0
    return mj


@pytest.mark.parametrize(
    ("xml", "cone"),
    [
        (FINGER, "elliptic"),
        pytest.param(FINGER, "pyramidal", marks=pytest.mark.slow),
        pytest.param(PILE, "pyramidal", marks=pytest.mark.slow),
    ],
)
def test_agrees_with_sweeps_that_converge(xml, cone):
    mj = swept(converging(xml, cone))
    datas = rollout(mj, 8, 20, seed=1, spread=0.5)
    assert np.mean([d.nefc for d in datas]) > 3
    found = forward_all(jaxsim.load(mj), datas)
    assert found.status.converged.all()
    for name in ("qacc", "qfrc_constraint"):
        assert_close(getattr(found, name), np.stack([getattr(d, name) for d in datas]), 1e-6, 1e-6)


@pytest.mark.slow
def test_pyramids_limit_friction_by_pairs_of_edges():
    """Each direction has the normal force of its own two edges."""
    mj = swept(converging(SLOPE.format(""), "pyramidal"))
    data = mujoco.MjData(mj)
    data.qpos[1], data.qvel[:] = -0.001, (0.3, 0)
    mujoco.mj_forward(mj, data)
    (found,) = forward_all(jaxsim.load(mj), [data]).qacc
    np.testing.assert_allclose(found, data.qacc, rtol=1e-8)


@pytest.mark.slow
def test_what_sticks_does_not_creep_and_has_exact_derivatives():
    """A push below friction changes nothing, one above it has slope h / m.

    With regularisation alone the block creeps: its velocity is proportional to the push.
    """
    model = jaxsim.load(SLOPE.format('noslip_iterations="3"'))
    creeping = jaxsim.load(SLOPE.format(""))
    state = jaxsim.make_state(model)

    def velocity(model, push):
        ctrls = jnp.broadcast_to(push, (200, 1))
        return jaxsim.rollout(model, state, ctrls)[0].qvel[0]

    both = quick_jit(
        lambda push: (
            velocity(model, push),
            jax.jacfwd(lambda p: velocity(model, p))(push),
            velocity(creeping, push),
        )
    )
    slow, none, creep = both(jnp.asarray(0.0))
    assert abs(slow) < 1e-9
    assert abs(none) < 1e-9
    assert creep > 1e-4
    fast, slope, _ = both(jnp.asarray(30.0))
    up, down = (both(jnp.asarray(30.0 + e))[0] for e in (1e-4, -1e-4))
    np.testing.assert_allclose(slope, (up - down) / 2e-4, rtol=1e-6)
    assert fast > 0.5


@pytest.mark.slow
def test_reverse_mode_agrees_with_forward_mode():
    model = jaxsim.load(SLOPE.format('noslip_iterations="3"'))
    state = jaxsim.make_state(model).replace(qpos=jnp.array([0.0, -1e-4]))

    def moved(numbers):
        at = state.replace(qvel=numbers[:2])
        friction = model.geom_friction.at[0, 0].set(numbers[2])
        return jaxsim.step(model.replace(geom_friction=friction), at, numbers[3:]).qvel

    forward, backward = jax.jacfwd(moved), jax.jacrev(moved)
    for numbers in ([0.3, 0.0, 0.5, 1.0], [0.0, 0.0, 0.5, 1.0]):
        one, other = quick_jit(lambda n: (forward(n), backward(n)))(jnp.array(numbers))
        np.testing.assert_allclose(one, other, atol=1e-10)
        assert np.abs(one).max() > 0.1
