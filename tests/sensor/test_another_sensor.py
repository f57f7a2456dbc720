"""A sensor of a callback, and a function of your own in its place as in `docs/extending.md`."""

import jax.numpy as jnp
import numpy as np

import jaxsim
from jaxsim.sensor import SENSORS

XML = """
<mujoco>
  <worldbody>
    <body><joint name="a" axis="0 1 0"/><joint axis="1 0 0"/><geom size=".1"/></body>
  </worldbody>
  <sensor>
    <user dim="1" needstage="vel"/>
    <jointvel joint="a"/>
  </sensor>
</mujoco>
"""


def speed(r, g):
    return jnp.broadcast_to(jnp.linalg.norm(r.motion.qvel), (len(g), 1))


def test_a_sensor_is_a_function_and_a_line(monkeypatch):
    monkeypatch.setitem(SENSORS, "USER", (speed, ()))
    model = jaxsim.load(XML)
    state = jaxsim.make_state(model).replace(qvel=jnp.array([3.0, 4.0]))
    np.testing.assert_allclose(jaxsim.forward(model, state).sensordata, [5, 3], rtol=1e-6)


def test_sensors_of_callbacks_read_zero_each_with_its_own_dimension():
    xml = XML.replace("<jointvel", '<user dim="3" needstage="acc"/><user dim="1"/><jointvel')
    model = jaxsim.load(xml)
    state = jaxsim.make_state(model).replace(qvel=jnp.array([3.0, 4.0]))
    np.testing.assert_array_equal(jaxsim.forward(model, state).sensordata, [0, 0, 0, 0, 0, 3])
