"""A type of sensor that `jaxsim` does not have, registered as `docs/extending.md` says."""

import jax.numpy as jnp
import numpy as np
import pytest

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
    with pytest.raises(jaxsim.ModelError, match="user"):
        jaxsim.load(XML)
    monkeypatch.setitem(SENSORS, "USER", (speed, ()))
    model = jaxsim.load(XML)
    state = jaxsim.make_state(model).replace(qvel=jnp.array([3.0, 4.0]))
    np.testing.assert_allclose(jaxsim.forward(model, state).sensordata, [5, 3], rtol=1e-6)
