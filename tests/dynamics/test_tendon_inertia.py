"""Armature of tendons: what depends on the mass matrix is as in MuJoCo, and energy is kept."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia

# Tendons along a chain, across branches, to a free body, with a pulley, and on a ball joint.
XML = """
<mujoco><option integrator="{}" timestep=".001"><flag energy="enable"/></option><worldbody>
  <site name="top" pos="0 0 2"/>
  <body pos="0 0 1"><joint name="a" axis="0 1 0" damping=".1"/>
    <geom size=".1" pos=".3 0 0"/><site name="a" pos=".2 0 .1"/>
    <body pos=".5 0 0"><joint name="b" type="ball"/>
      <geom size=".1" pos=".3 .05 0"/><site name="b" pos=".2 0 .1"/></body>
    <body pos=".5 .3 0"><joint name="c" axis="0 1 .2" range="-.1 .1" limited="true"/>
      <geom type="capsule" size=".05 .1" pos=".3 0 0"/><site name="c" pos=".1 .1 .1"/></body>
  </body>
  <body pos="0 1 1"><freejoint/><geom type="box" size=".1 .2 .3" pos=".1 0 0"/>
    <site name="d" pos=".1 .1 .1"/>
  </body>
</worldbody><tendon>
  <fixed name="fixed" armature=".3"><joint joint="a" coef="1"/><joint joint="c" coef="2"/></fixed>
  <spatial name="chain" armature="2"><site site="top"/><site site="b"/></spatial>
  <spatial name="across" armature=".05"><site site="b"/><site site="c"/>
    <pulley divisor="2"/><site site="a"/><site site="c"/></spatial>
  <spatial name="free"><site site="top"/><site site="d"/></spatial>
</tendon><actuator><motor tendon="free" gear="2" armature=".7"/><motor tendon="chain"/></actuator>
</mujoco>
"""
NAMES = "mass_matrix qfrc_bias energy qacc_smooth qacc inverse qvel"


@pytest.mark.parametrize(
    "integrator",
    ["implicitfast", *(pytest.param(i, marks=pytest.mark.slow) for i in ("Euler", "implicit"))],
)
def test_everything_agrees_with_mujoco(integrator, x64):
    mj = mujoco.MjModel.from_xml_string(XML.format(integrator))
    mj.opt.tolerance, mj.opt.iterations = 0, 100
    model, ctrl = jaxsim.load(mj), jnp.array([1.0, -2.0])
    state, data, rng = jaxsim.make_state(model), mujoco.MjData(mj), np.random.default_rng(0)

    def ours(q, v):
        now = state.replace(qpos=q, qvel=v)
        out, after = jaxsim.forward(model, now, ctrl), jaxsim.step(model, now, ctrl)
        found = {name: getattr(out, name) for name in NAMES.split()[:5]}
        return found | {"inverse": jaxsim.inverse(model, now, 0 * v + 1), "qvel": after.qvel}

    compute = quick_jit(ours)
    for _ in range(3):
        q, v = data.qpos.copy(), rng.normal(size=mj.nv)
        mujoco.mj_integratePos(mj, q, rng.normal(size=mj.nv), 0.3)
        for name, theirs in _theirs(mj, q, v, np.asarray(ctrl)).items():
            np.testing.assert_allclose(compute(q, v)[name], theirs, 1e-9, 1e-9, err_msg=name)


def _theirs(mj, qpos, qvel, ctrl) -> dict:
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
    mujoco.mj_forward(mj, data)
    found = {name: getattr(data, name).copy() for name in NAMES.split()[1:5]}
    found["mass_matrix"] = np.zeros((mj.nv, mj.nv))
    mujoco.mj_fullM(mj, data, found["mass_matrix"])
    data.qacc[:] = 1
    mujoco.mj_inverse(mj, data)
    found["inverse"] = data.qfrc_inverse.copy()
    mujoco.mj_forward(mj, data)
    mujoco.mj_step(mj, data)
    return found | {"qvel": data.qvel.copy()}


def test_constants_and_what_may_be_replaced(x64):
    mj = mujoco.MjModel.from_xml_string(XML.format("Euler"))
    model = jaxsim.load(mj)
    found, data = quick_jit(jaxsim.set_const)(model), mujoco.MjData(mj)
    mujoco.mj_setConst(mj, data)
    for name in "dof_M0 dof_invweight0 body_invweight0 tendon_invweight0 actuator_acc0".split():
        np.testing.assert_allclose(getattr(found, name), getattr(mj, name), 1e-9, err_msg=name)
    bare = XML.format("Euler").replace("armature", "margin").replace('gear="2" margin', "user")
    bare = jaxsim.load(bare.replace('user=".7"', ""))
    assert not has_tendon_inertia(bare)
    assert has_tendon_inertia(bare.replace(tendon_armature=model.tendon_armature))


CHAIN = """
<mujoco><option integrator="RK4" timestep=".002"/><worldbody><site name="top" pos="0 .2 2"/>
  <body pos="0 0 1"><joint axis="0 1 0"/><geom size=".1" pos=".3 0 0"/>
    <body pos=".5 0 0"><joint type="ball"/>
      <geom size=".1" pos=".3 .05 0"/><site name="b" pos=".2 0 .1"/></body></body>
</worldbody><tendon><spatial armature="3"><site site="top"/><site site="b"/></spatial></tendon>
</mujoco>
"""


def test_energy_is_conserved(x64):
    """A bias that did not fit the mass matrix would add or take energy."""
    model = jaxsim.load(CHAIN)
    state = jaxsim.make_state(model).replace(qvel=jnp.array([1.0, -2.0, 1.0, 3.0]))

    @quick_jit
    def energies(state):
        final, _ = jaxsim.rollout(model, state, jnp.zeros((500, 0)))
        return jnp.stack([jaxsim.forward(model, s).energy for s in (state, final)])

    start, end = energies(state)
    assert abs(end[1] - start[1]) > 0.1
    np.testing.assert_allclose(end.sum(), start.sum(), atol=1e-6)


def test_derivatives_are_those_of_differences(x64):
    model = jaxsim.load(CHAIN)
    state = jaxsim.make_state(model)

    def acceleration(qpos, armature):
        now = state.replace(qpos=qpos, qvel=jnp.array([1.0, -2.0, 1.0, 3.0]))
        return jaxsim.forward(model.replace(tendon_armature=armature), now).qacc

    at = state.qpos.at[0].set(0.3), model.tendon_armature
    along = jnp.array([1.0, 0, 0.5, 0, 0]), jnp.ones(1)
    compute = quick_jit(lambda t: acceleration(at[0] + t * along[0], at[1] + t * along[1]))
    slope = quick_jit(lambda: jax.jvp(acceleration, at, along)[1])()
    np.testing.assert_allclose(slope, (compute(1e-5) - compute(-1e-5)) / 2e-5, 1e-6, 1e-7)
