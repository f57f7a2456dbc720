"""Delayed controls and sensors: agreement with MuJoCo, laws, derivatives, and what is refused."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.arrays.samples import CUBIC, HOLD, LINEAR, signal_at
from jaxsim.model.history import history_of

XML = """
<mujoco><option timestep=".003" integrator="{}"><flag contact="disable"/></option>
<worldbody><body><joint name="h1" axis="0 1 0" damping=".05"/>
  <geom size=".05 .2" type="capsule" pos=".1 0 .1"/>
  <body name="b" pos="0 0 .4"><joint name="h2" axis="1 0 0" damping=".05"/>
    <geom size=".05 .2" type="capsule" pos="0 .1 .1"/><site name="s"/></body></body></worldbody>
<actuator>
  <motor joint="h1" nsample="4" delay=".012" ctrlrange="-2 2"/>
  <motor joint="h2" nsample="5" delay=".0071" interp="linear"/>
  <general joint="h2" nsample="5" delay=".0083" interp="cubic" dyntype="filter" dynprm=".1"/>
  <pid joint="h1" kp="3" kv=".4" ki="1" nsample="5" delay=".0052"/>
  <motor joint="h1" nsample="4"/><motor joint="h1"/></actuator>
<sensor>
  <jointpos joint="h1" nsample="4" delay=".0107"/>
  <jointvel joint="h1" nsample="4" delay=".0107" interp="linear"/>
  <framequat objtype="body" objname="b" nsample="6" delay=".011" interp="cubic"/>
  <accelerometer site="s" nsample="3" interval=".0077 -.002"/>
  <gyro site="s" nsample="3" interval=".0077" delay=".0101" interp="linear"/>
  <gyro site="s" nsample="2"/><gyro site="s"/><clock nsample="3" interval=".0101"/>
  <accelerometer site="s" nsample="2" delay=".004" cutoff="5"/>
  <e_kinetic nsample="2" delay=".004"/></sensor></mujoco>
"""


@pytest.mark.parametrize("integrator", ["Euler", pytest.param("RK4", marks=pytest.mark.slow)])
def test_trajectory(integrator, rng, x64):
    mj = mujoco.MjModel.from_xml_string(XML.format(integrator))
    model, data = jaxsim.load(mj), mujoco.MjData(mj)
    ctrls, states, readings, histories = rng.normal(size=(150, mj.nu)) * 1.5, [], [], []
    for ctrl in ctrls:
        data.ctrl[:] = ctrl
        mujoco.mj_step(mj, data)
        states.append(np.concatenate([data.qpos, data.qvel, data.act]))
        readings.append(data.sensordata.copy())
        histories.append(history_of(model, data.history, data.time))

    def body(state, ctrl):
        now = jaxsim.forward(model, state, ctrl)
        after = jaxsim.step(model, state, ctrl)
        return after, (after, now.sensordata)

    start = jaxsim.make_state(model)
    final, (found, sensordata) = quick_jit(lambda c: jax.lax.scan(body, start, c))(ctrls)
    moved = np.concatenate([found.qpos, found.qvel, found.act], axis=1)
    np.testing.assert_allclose(moved, states, atol=1e-10, rtol=1e-10)
    if integrator == "RK4":  # MuJoCo remembers readings of the fourth stage.
        return
    np.testing.assert_allclose(sensordata, readings, atol=1e-10, rtol=1e-10)
    np.testing.assert_allclose(found.history, histories, atol=1e-10, rtol=1e-10)
    _, exported = jaxsim.to_mujoco(model, final, data.ctrl)
    again = history_of(model, exported.history, exported.time)
    np.testing.assert_allclose(again, final.history, atol=1e-12)
    mujoco.mj_forward(mj, data)
    np.testing.assert_allclose(exported.sensordata, data.sensordata, atol=1e-10)
    np.testing.assert_allclose(exported.actuator_force, data.actuator_force, atol=1e-10)


CART = """
<mujoco><option timestep=".01" gravity="0 0 0"/><worldbody>
  <body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body></worldbody>
<actuator><motor joint="x" nsample="6" delay=".03" interp="{}"/></actuator>
<sensor><jointpos joint="x" nsample="8" delay=".05"/></sensor></mujoco>
"""


def test_delays_of_whole_time_steps_in_float32(rng):
    """Late in a simulation, too, where float32 times are rounded to a tenth of a time step."""
    model = jaxsim.load(CART.format("zoh"))
    start = jaxsim.make_state(model).replace(time=jnp.float32(1e4))
    ctrls = jnp.asarray(rng.normal(size=(4, 40, 1)), jnp.float32)
    starts = jax.tree.map(lambda x: jnp.broadcast_to(x, (4, *x.shape)), start)

    def observe(state):
        return jaxsim.forward(model, state).sensordata, state.qpos, state.qvel

    final, (read, qpos, qvel) = jaxsim.batch_rollout(model, starts, ctrls, observe)
    late = jnp.pad(ctrls, ((0, 0), (3, 0), (0, 0)))[:, :40]
    np.testing.assert_allclose(qvel, 0.01 * jnp.cumsum(late, axis=1), atol=1e-6)
    np.testing.assert_array_equal(read[:, 5:], qpos[:, :-5])
    assert final.history.shape == (4, model.nhistory)


def test_derivatives_and_nan(rng, x64):
    model = jaxsim.load(CART.format("linear").replace('delay=".03"', 'delay=".0234"'))
    state = jaxsim.make_state(model)
    ctrls = jnp.asarray(rng.normal(size=(9, 1)))

    def of(x):
        here = model.replace(actuator_delay=x[9:])
        return jaxsim.rollout(here, state, x[:9, None])[0].qpos[0]

    x = jnp.concatenate([ctrls[:, 0], model.actuator_delay])
    along = jnp.asarray(rng.normal(size=10)) * 1e-5
    ways = [x, x + along, x - along, x.at[0].set(jnp.nan), x.at[8].set(jnp.nan)]
    both = lambda x: (jax.jvp(of, (x,), (along,)), jax.grad(of)(x))  # noqa: E731
    (moved, forward), reverse = quick_jit(jax.vmap(both))(jnp.stack(ways))
    _, ahead, behind, spoiled, late = moved
    forward, reverse = forward[0], reverse[0]
    np.testing.assert_allclose(forward, (ahead - behind) / 2, rtol=1e-6)
    np.testing.assert_allclose(reverse @ along, forward, rtol=1e-12)
    assert reverse[9] != 0
    assert np.isnan(spoiled)
    assert np.isfinite(late)  # the last control does not act yet


@pytest.mark.parametrize(("order", "between"), [(HOLD, 3), (LINEAR, 4), (CUBIC, 4.125)])
def test_signal_between_samples(order, between):
    times = jnp.array([-0.7, -0.5, -0.3, -0.1])
    values = jnp.array([[1.0], [3.0], [5.0], [5.0]])
    read = lambda t: signal_at(times, values, jnp.float32(t), order, 1e-6)[0]  # noqa: E731
    for at, expected in ((-9, 1), (-0.5, 3), (-0.4, between), (-0.3, 5), (0, 5)):
        np.testing.assert_allclose(read(at), expected, rtol=1e-5)


def test_models_without_delays_remember_nothing():
    xml = CART.format("zoh").replace('delay=".03"', "").replace('delay=".05"', "")
    model = jaxsim.load(xml)
    assert "nsample" in xml
    assert jaxsim.make_state(model).history is None
    assert model.actuator_delay is None
    assert model.nhistory == 0


def test_what_is_refused():
    model = jaxsim.load(CART.format("zoh"))
    state = jaxsim.make_state(model)
    with pytest.raises(TypeError, match="state.history must be an array, got NoneType"):
        jaxsim.step(model, state.replace(history=None))
    with pytest.raises(ValueError, match="state.history must have shape"):
        jaxsim.step(model, state.replace(history=state.history[1:]))
    with pytest.raises(ValueError, match="substeps|delays"):
        jaxsim.substeps(model, state, count=2)
    with pytest.raises(jaxsim.ModelError, match="delays and intervals"):
        jaxsim.to_maximal(model)
    other = jaxsim.load("pendulum")
    wrong = jaxsim.make_state(other).replace(history=jnp.zeros(3))
    with pytest.raises(ValueError, match="the model has no delays"):
        jaxsim.step(other, wrong)
    with pytest.raises(ValueError, match="loaded without delays"):
        jaxsim.step(other.replace(actuator_delay=jnp.ones(other.nactuator)), wrong)
