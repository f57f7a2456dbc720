"""Sensors: laws, agreement with MuJoCo for every type, and what is refused."""

import functools
from importlib import resources

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco_records import evaluated, record, rollout

from jaxsim.dynamics.motion import Motion
from jaxsim.io import build
from jaxsim.sensor import SENSORS, Signals, needs, sensordata


@pytest.fixture
def read(signals):
    """Function from an MjModel and data to our sensordata."""
    return lambda mj, d: _reader(signals)(build(mj), record(mj, d))


@functools.cache
def _reader(signals):
    return jax.jit(lambda model, values: sensordata(signals(model, values)))


def assert_equal_by_sensor(mj, actual, expected):
    """Compare sensor by sensor, relative to the norm, so that a failure names the sensor."""
    for s in range(mj.nsensor):
        at = slice(mj.sensor_adr[s], mj.sensor_adr[s] + mj.sensor_dim[s])
        error = np.linalg.norm(actual[at] - expected[at])
        name = mujoco.mjtSensor(int(mj.sensor_type[s])).name
        assert error <= 1e-10 * (1 + np.linalg.norm(expected[at])), (
            name,
            s,
            actual[at],
            expected[at],
        )


def no_signals(model):
    """Signals that must not be read."""
    return Signals(Motion(model, model.qpos0, jnp.zeros(model.nv), kin=None, vel=None))


PENDULUM = """
<mujoco><worldbody>
  <body pos="0 0 1"><joint axis="0 1 0"/><geom size=".1" pos="0 0 -.5" mass="2"/>
    <site name="tip" pos="0 0 -.5"/></body>
  <body pos="3 0 5"><freejoint/><geom size=".1 .2 .3" type="box" mass="1.5"/>
    <site name="falling"/></body>
  <site name="bolted"/>
</worldbody><sensor>
  <accelerometer site="tip"/><force site="tip"/><torque site="tip"/>
  <gyro site="tip"/><velocimeter site="tip"/>
  <accelerometer site="falling"/><force site="falling"/><accelerometer site="bolted"/>
</sensor></mujoco>
"""


def test_laws_of_weight_and_rotation(oracle, read, x64):
    mj, data = oracle(PENDULUM)
    hanging = read(mj, data).reshape(-1, 3)
    np.testing.assert_allclose(hanging[0], [0, 0, 9.81], atol=1e-12)
    np.testing.assert_allclose(hanging[1], [0, 0, 2 * 9.81], atol=1e-12)
    np.testing.assert_allclose(hanging[2:], 0, atol=1e-12)
    data.qvel[0] = 3.0
    swinging = read(mj, evaluated(mj, data)).reshape(-1, 3)
    np.testing.assert_allclose(swinging[0], [0, 0, 9.81 + 3**2 * 0.5], atol=1e-12)
    np.testing.assert_allclose(swinging[3], [0, 3, 0], atol=1e-12)
    np.testing.assert_allclose(swinging[4], [-1.5, 0, 0], atol=1e-12)


@pytest.mark.parametrize("instant", range(6))
def test_every_sensor_agrees_with_mujoco(menagerie, read, instant, x64):
    data = _menagerie_rollout(menagerie)[instant]
    assert_equal_by_sensor(menagerie, read(menagerie, data), data.sensordata)


@functools.cache
def _menagerie_rollout(mj):
    return rollout(mj)


def test_the_model_of_everything_has_everything(menagerie):
    types = {mujoco.mjtSensor(int(t)).name.removeprefix("mjSENS_") for t in menagerie.sensor_type}
    assert types == set(SENSORS)
    data = np.array([d.sensordata for d in _menagerie_rollout(menagerie)])
    for s in range(menagerie.nsensor):
        kind = mujoco.mjtSensor(int(menagerie.sensor_type[s])).name
        if "LIMIT" in kind and menagerie.sensor_objid[s] == 1:
            # Otherwise the comparison would be of zeros with zeros.
            assert (data[:, menagerie.sensor_adr[s]] != 0).any(), kind
    touches = menagerie.sensor_adr[menagerie.sensor_type == int(mujoco.mjtSensor.mjSENS_TOUCH)]
    assert (data[:, touches] > 0).any(0).sum() >= 3
    assert (data[:, touches] == 0).any()


@pytest.mark.slow
def test_mjx_sensor_model(read, x64):
    path = resources.files("mujoco.mjx") / "test_data/sensor/sensor.xml"
    mj = mujoco.MjModel.from_xml_path(str(path))
    for data in rollout(mj, count=3, every=4):
        assert_equal_by_sensor(mj, read(mj, data), data.sensordata)


TOUCH = """
<mujoco><worldbody><geom name="floor" type="plane" size="5 5 1"/>
  <body pos="0 0 .095"><freejoint/><geom size=".1"/>
    <site name="a" pos="0 0 -.1" size=".02"/></body>
  <body pos="1 0 .095"><freejoint/><geom size=".1"/>
    <site name="b" pos=".09 0 -.1" size=".02"/></body>
</worldbody><sensor><touch site="a"/><touch site="b"/></sensor></mujoco>
"""


def test_touch_with_static_and_without_contacts(oracle, signals, x64):
    mj, data = oracle(TOUCH)
    model, values = build(mj), record(mj, data)
    none = values | {
        "contact": jax.tree.map(lambda a: a[:0], values["contact"]),
        "contact_force": values["contact_force"][:0],
    }
    # The contacts are not arguments, so their geoms are static.
    pressed, lifted = jax.jit(lambda: [sensordata(signals(model, v)) for v in (values, none)])()
    assert data.sensordata[0] > 0
    np.testing.assert_allclose(pressed, [data.sensordata[0], 0], rtol=1e-12)
    np.testing.assert_array_equal(lifted, [0, 0])


def test_cutoff_can_be_changed_and_batched(oracle, read, x64):
    mj, data = oracle(PENDULUM)
    data.qvel[0] = 3.0
    data = evaluated(mj, data)
    mj.sensor_cutoff[0] = 2.0
    clipped = read(mj, data)
    np.testing.assert_allclose(clipped[:3], np.clip(data.sensordata[:3], -2, 2), atol=1e-12)
    np.testing.assert_allclose(clipped[3:], data.sensordata[3:], atol=1e-12)


def test_disabled_sensors_read_zero_and_need_nothing(oracle):
    off = '<mujoco><option><flag sensor="disable"/></option>'
    model = build(oracle(PENDULUM.replace("<mujoco>", off))[0])
    assert needs(model) == frozenset()
    np.testing.assert_array_equal(sensordata(no_signals(model)), np.zeros(24))


def test_limits_switched_off_read_zero(oracle, read):
    for flag in ("limit", "constraint"):
        mj, data = oracle(
            f'<mujoco><option><flag {flag}="disable"/></option><worldbody><body>'
            '<joint name="j" range="-1 -.5" limited="true"/><geom size=".1"/></body></worldbody>'
            '<tendon><fixed name="t" range="1 2"><joint joint="j" coef="1"/></fixed></tendon>'
            '<sensor><jointlimitpos joint="j"/><tendonlimitvel tendon="t"/></sensor></mujoco>'
        )
        np.testing.assert_array_equal(read(mj, data), [0, 0])


def test_needs_names_what_the_sensors_read(oracle):
    model = build(oracle(PENDULUM)[0])
    assert needs(model) == {"qacc", "body_wrench"}
    with pytest.raises(ValueError, match="body_wrench, qacc"):
        sensordata(no_signals(model))


def test_model_without_sensors(oracle):
    model = build(oracle(TOUCH.split("<sensor>")[0] + "</mujoco>")[0])
    assert sensordata(no_signals(model)).shape == (0,)


def test_precision_follows_the_signals(oracle, read):
    mj, data = oracle(PENDULUM)
    values = read(mj, data)
    assert values.dtype == jnp.float32
    np.testing.assert_allclose(values, data.sensordata, atol=1e-4)
