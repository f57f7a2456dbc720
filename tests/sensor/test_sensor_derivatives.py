"""Derivatives of sensors: finite at singular states, and equal in both modes and to differences."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco_records import record

from jaxsim.io import build
from jaxsim.sensor import sensordata

XML = """
<mujoco><worldbody><geom type="plane" size="5 5 1"/>
  <body name="a" pos="0 0 .09"><freejoint/><geom size=".1"/><site name="a" size=".2"/>
    <site name="e" type="ellipsoid" size=".2 .1 .1"/><site name="b" type="box" size=".2 .1 .1"/>
    <body name="c" pos=".3 0 0">
      <joint name="ball" type="ball" range="0 20" limited="true" margin=".5"/>
      <geom size=".1" pos=".2 0 0"/><site name="c" pos=".1 0 0"/></body></body>
</worldbody><sensor>
  <touch site="a"/><touch site="e"/><touch site="b"/><accelerometer site="c"/>
  <torque site="c"/><ballquat joint="ball"/>
  <jointlimitpos joint="ball"/><jointlimitvel joint="ball"/>
  <framequat objtype="site" objname="c" reftype="body" refname="a"/>
  <framelinvel objtype="site" objname="c" reftype="site" refname="a"/>
  <subtreeangmom body="a"/>
  <insidesite objtype="body" objname="c" site="e"/>
</sensor></mujoco>
"""


@pytest.fixture(scope="module")
def scene():
    mj = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    return mj, data


@pytest.fixture
def function(scene, signals):
    """Readings from qpos, qvel and qacc in one vector, the rest as MuJoCo left it; its input."""
    mj, data = scene
    model, values = build(mj), record(mj, data)
    values["contact"] = jax.tree.map(lambda a: a[:1], values["contact"])
    values["contact_force"] = values["contact_force"][:1]
    names = ("qpos", "qvel", "qacc")
    ends = np.cumsum([len(values[name]) for name in names])

    def f(x):
        motion = zip(names, jnp.split(x, ends[:-1]), strict=True)
        return sensordata(signals(model, values | dict(motion)))

    return f, jnp.asarray(np.concatenate([values[name] for name in names]), float)


def test_derivatives_at_rest_and_in_motion(x64, function, rng):
    f, rest = function
    step, noise = (jnp.asarray(rng.normal(size=len(rest))) for _ in range(2))
    along = jax.jit(lambda x: jax.jvp(f, (x,), (step,)))
    values, forward = along(rest)
    # At rest every angle, velocity and arm that a norm or a quotient could meet is zero.
    assert np.isfinite(values).all()
    assert np.isfinite(forward).all()
    weight = jnp.asarray(rng.normal(size=len(values)))
    reverse = jax.jit(jax.grad(lambda x: weight @ f(x)))(rest)
    assert np.isfinite(reverse).all()
    np.testing.assert_allclose(reverse @ step, weight @ forward, rtol=1e-9)
    moving, h = rest + 0.2 * noise.at[:7].set(0), 1e-6
    difference = (along(moving + h * step)[0] - along(moving - h * step)[0]) / (2 * h)
    np.testing.assert_allclose(along(moving)[1], difference, atol=1e-6, rtol=1e-6)
