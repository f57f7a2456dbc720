"""Sensors on cameras: all modes and projections agree with MuJoCo, and have derivatives."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.velocity import velocities
from jaxsim.sensor import Signals, sensordata

MODES = {
    "fixed": 'mode="fixed"',
    "track": 'mode="track"',
    "trackcom": 'mode="trackcom"',
    "target": 'mode="targetbody" target="ball"',
    "targetcom": 'mode="targetbodycom" target="arm"',
    "calibrated": 'sensorsize=".02 .03" focal=".03 .02" principal=".001 .002"',
    "parallel": 'projection="orthographic" fovy=".8"',
}
KINDS = "pos quat xaxis yaxis zaxis linvel angvel linacc angacc".split()


def _xml() -> str:
    cameras = "".join(
        f'<camera name="{name}" pos=".1 {0.02 * i} .05" euler="{20 + 5 * i} 10 -20" '
        f'resolution="3 2" {mode}/>'
        for i, (name, mode) in enumerate(MODES.items())
    )
    sensors = ""
    for name in MODES:
        sensors += f'<camprojection site="mark" camera="{name}"/>'
        sensors += f'<rangefinder camera="{name}" data="dist dir origin point normal depth"/>'
        for i, kind in enumerate(KINDS):
            sensors += f'<frame{kind} objtype="camera" objname="{name}"/>'
            if i < 7:
                sensors += f"""<frame{kind} objtype="camera" objname="{name}" reftype="xbody"
                  refname="ball"/><frame{kind} objtype="site" objname="mark" reftype="camera"
                  refname="{name}"/>"""
    sensors += '<insidesite site="mark" objtype="camera" objname="fixed"/>'
    return f"""<mujoco><option><flag contact="disable"/></option><worldbody>
      <geom type="plane" size="5 5 1" pos="0 0 -1"/>
      <body name="arm" pos="0 0 1"><joint axis="0 1 .2"/><geom type="capsule" size=".05 .2"/>
        <body name="hand" pos=".1 0 .3"><joint type="ball"/>
          <geom type="box" size=".05 .1 .02"/>{cameras}</body></body>
      <body name="ball" pos=".2 .3 -.5"><freejoint/><geom size=".3"/>
        <site name="mark" pos="0 .1 .02" size=".9"/></body>
    </worldbody><sensor>{sensors}</sensor></mujoco>"""


@pytest.fixture(scope="module")
def mj():
    return mujoco.MjModel.from_xml_string(_xml())


def test_all_sensors_of_cameras_agree_with_mujoco(mj, x64):
    model, data = jaxsim.load(mj), mujoco.MjData(mj)
    rng = np.random.default_rng(0)
    read = quick_jit(lambda qpos, *rest: jax.jvp(_reader(model, *rest), (qpos,), (0 * qpos + 1,)))
    for _ in range(3):
        data.qvel[:] = rng.normal(size=mj.nv)
        mujoco.mj_integratePos(mj, data.qpos, data.qvel, 0.3)
        mujoco.mj_forward(mj, data)
        got, slope = read(*(jnp.array(x) for x in (data.qpos, data.qvel, data.qacc)))
        assert np.isfinite(slope).all()
        for s in range(mj.nsensor):
            at = slice(mj.sensor_adr[s], mj.sensor_adr[s] + mj.sensor_dim[s])
            # MuJoCo stores the calibration of cameras in single precision.
            near = 1e-6 if "calibrated" in (_camera(mj, s), _reference(mj, s)) else 1e-9
            message = f"{mujoco.mjtSensor(int(mj.sensor_type[s])).name} {_camera(mj, s)}"
            np.testing.assert_allclose(got[at], data.sensordata[at], near, near, err_msg=message)


def _reader(model, qvel, qacc):
    """Function from qpos to the readings."""

    def readings(qpos):
        kin = kinematics(model, qpos)
        motion = Motion(model, qpos, qvel, kin, velocities(model, kin, qvel))
        return sensordata(Signals(motion, qacc=qacc))

    return readings


def _camera(mj, s):
    return mj.camera(mj.sensor_objid[s]).name if mj.sensor_objtype[s] == 7 else ""


def _reference(mj, s):
    return mj.camera(mj.sensor_refid[s]).name if mj.sensor_reftype[s] == 7 else ""


def test_a_camera_above_its_target_has_mujocos_axes(x64):
    xml = """<mujoco><worldbody>
      <camera name="eye" pos="0 0 1" mode="targetbody" target="ball"/>
      <body name="ball"><joint type="slide"/><geom size=".1"/></body></worldbody>
      <sensor><framexaxis objtype="camera" objname="eye"/>
        <frameyaxis objtype="camera" objname="eye"/></sensor></mujoco>"""
    mj = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    readings = _reader(jaxsim.load(mj), jnp.zeros(1), jnp.zeros(1))
    got, slope = quick_jit(lambda q: (readings(q), jax.jacrev(readings)(q)))(jnp.zeros(1))
    np.testing.assert_allclose(got, data.sensordata, atol=1e-12)
    assert np.isfinite(slope).all()
