"""Touch grids: agreement with MuJoCo in generic contacts, laws, derivatives, refusals."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco_records import evaluated, record

from jaxsim.io import build, load
from jaxsim.model import ModelError
from jaxsim.sensor import sensordata


def grid(site: str, channels: int, size: str, view: str = "180 90", gamma: float = 0) -> str:
    values = {"nchannel": channels, "size": size, "fov": view, "gamma": gamma}
    config = "".join(f'<config key="{key}" value="{value}"/>' for key, value in values.items())
    kind = 'plugin="mujoco.sensor.touch_grid" objtype="site"'
    return f'<plugin {kind} objname="{site}">{config}</plugin>'


XML = """
<mujoco>
  <extension><plugin plugin="mujoco.sensor.touch_grid"/></extension>
  <worldbody>
    <geom type="plane" size="5 5 1"/><site name="world" pos=".1 .2 .3" euler="20 160 30"/>
    <body pos="0 0 .2"><freejoint/>
      <geom type="capsule" size=".1 .3" condim="6" friction="1 .1 .1"/>
      <site name="rod" pos=".02 0 .1" euler="20 50 70"/>
      <body pos=".3 0 0"><geom type="box" size=".1 .2 .1" condim="4" friction="1 .1 .1"/>
        <site name="box" euler="-10 30 5"/></body>
    </body>
    <body pos=".2 .1 .5"><freejoint/><geom size=".15"/><site name="ball" euler="5 -20 0"/></body>
  </worldbody>
  <sensor>{}</sensor>
</mujoco>
"""
SENSORS = [
    grid("world", 6, "7 5"),
    grid("rod", 6, "4 3", gamma=0.6),
    grid("box", 3, "5 6", "160 85", 1),
    grid("box", 2, "1 1"),
    grid("ball", 0, "3 3", "120 80", 0.3),
    grid("ball", 3, "3 3", "120 80").replace("<plugin", '<plugin cutoff=".5"'),
]


@pytest.fixture
def read(signals, x64):
    """Function from contact forces and a record to readings of `SENSORS`."""
    model = build(mujoco.MjModel.from_xml_string(XML.format("".join(SENSORS))))
    return jax.jit(
        lambda force, values: sensordata(signals(model, values | {"contact_force": force}))
    )


def instants(mj: mujoco.MjModel, count: int) -> list[mujoco.MjData]:
    """Bodies that have fallen on each other, at several times."""
    data, found = mujoco.MjData(mj), []
    data.qvel[:] = np.random.default_rng(4).normal(size=mj.nv)
    for _ in range(count):
        mujoco.mj_step(mj, data, 60)
        found.append(evaluated(mj, data))
    return found


def test_readings_agree_with_mujoco(read):
    mj = mujoco.MjModel.from_xml_string(XML.format("".join(SENSORS)))
    expected = np.array([data.sensordata for data in instants(mj, 12)])
    records = [record(mj, data) for data in instants(mj, 12)]
    got = np.array([read(values["contact_force"], values) for values in records])
    np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9 * abs(expected).max())
    assert (expected != 0).any(axis=0).sum() > 40
    for s in range(mj.nsensor):
        image = expected[:, mj.sensor_adr[s] :][:, : mj.sensor_dim[s]]
        assert (image != 0).any(), s


def test_a_whole_sphere_sees_the_weight(oracle, signals, x64):
    xml = """<mujoco><extension><plugin plugin="mujoco.sensor.touch_grid"/></extension><worldbody>
      <geom type="plane" size="5 5 1"/>
      <body pos="0 0 .1"><freejoint/><geom size=".1" mass="2"/>
      <site name="s" euler="30 0 0"/></body></worldbody><sensor>{}</sensor></mujoco>"""
    mj, data = oracle(xml.format(grid("s", 3, "2 3")))
    mujoco.mj_step(mj, data, 2000)
    values = record(mj, evaluated(mj, data))
    force = np.asarray(sensordata(signals(build(mj), values))).reshape(3, -1).sum(1)
    mat = data.site_xmat[0].reshape(3, 3)
    np.testing.assert_allclose(force, (mat.T @ [0, 0, 2 * 9.81])[[2, 0, 1]], rtol=1e-4)


def test_readings_are_linear_in_the_forces(read):
    mj = mujoco.MjModel.from_xml_string(XML.format("".join(SENSORS[:5])))
    values = record(mj, instants(mj, 12)[-1])
    force, other = values["contact_force"], np.roll(values["contact_force"], 1, axis=1)
    several = jax.vmap(lambda f: read(f, values)[: mj.nsensordata])(jnp.stack([force, other]))
    slope = jax.jvp(lambda f: read(f, values)[: mj.nsensordata], (force,), (other,))[1]
    assert abs(slope).max() > 1
    np.testing.assert_allclose(slope, several[1], atol=1e-12)


def test_a_grid_has_a_plugin_instance_of_its_own():
    shared = '<plugin name="{}" instance="i" objtype="site" objname="ball"/>'
    instance = '<instance name="i"><config key="size" value="1 1"/><config key="fov" value="9 9"/>'
    xml = XML.replace('grid"/>', f'grid">{instance}</instance></plugin>')
    load(xml.format(shared.format("a")))
    with pytest.raises(ModelError, match="sensor 'b': MuJoCo computes one touch grid for each"):
        load(xml.format(shared.format("a") + shared.format("b")))


def test_other_plugins_of_sensors_are_refused():
    mj = mujoco.MjModel.from_xml_string(XML.format(SENSORS[0]))
    mj.plugin[0] = 77
    with pytest.raises(ModelError, match="sensor number 0 .* the only plugin of sensors"):
        load(mj)
