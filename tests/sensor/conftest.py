"""A model with every supported sensor, and signals taken from MuJoCo."""

import itertools

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.velocity import velocities
from jaxsim.forces.external import external_wrench
from jaxsim.sensor import Signals

WORLD = """
<extension><plugin plugin="mujoco.sensor.touch_grid"/></extension>
<worldbody>
  <geom name="floor" type="plane" size="5 5 .1"/>
  <site name="fixed" pos=".2 0 .3" euler="10 20 30" size=".4" type="box"/>
  <body name="wall" pos="-2 0 1" euler="0 30 0">
    <geom size=".2 .3 .1" type="box" pos=".1 0 .2" mass="3"/>
    <site name="wall" pos=".1 .2 .3" euler="40 0 20"/>
    <site name="hinge" pos=".2 0 .1"/>
  </body>
  <body name="handle" mocap="true" pos="-2 1 1.6"><site name="handle" euler="0 0 50"/></body>
  <body name="base" pos="0 0 .25">
    <freejoint name="base"/>
    <geom name="base" type="box" size=".3 .2 .1" mass="4" euler="5 0 3" pos=".02 0 .01"/>
    <camera name="eye" pos="0 0 .2" euler="30 20 0" resolution="2 2"/>
    <site name="base" pos=".1 -.1 .05" euler="20 -30 40"/>
    <site name="patch" type="box" pos=".3 .2 -.1" size=".1 .1 .1"/>
    <body name="arm" pos=".3 0 .1" euler="0 20 0">
      <joint name="ball" type="ball" pos=".02 0 .01" range="0 30" margin=".02" damping=".3"/>
      <geom name="arm" type="capsule" size=".05" fromto="0 0 0 .1 0 .4"/>
      <site name="arm" pos="0 0 .3" euler="10 50 0" type="ellipsoid" size=".2 .1 .3"/>
      <body name="plate" pos="0 0 .4" euler="30 0 0">
        <geom name="plate" type="box" size=".1 .05 .02" mass=".3"/>
        <site name="plate" pos=".05 0 0" euler="0 15 0"/>
      </body>
      <body name="hand" pos="0 .1 .4">
        <joint name="hinge" axis="0 1 .2" range="-20 40" margin=".01"/>
        <joint name="slide" type="slide" axis="1 0 .3" range="-.05 .08" margin=".005"/>
        <geom name="hand" size=".08" pos="0 .05 0" condim="4"/>
        <site name="hand" pos="0 0 .1" type="cylinder" size=".1 .12"/>
      </body>
    </body>
  </body>
  <body name="rod" pos="0 -.6 .06">
    <freejoint/>
    <geom name="rod" type="capsule" size=".05 .3" euler="0 90 0" condim="6"/>
    <site name="rod" type="capsule" size=".08 .1" pos=".3 0 0" euler="0 90 0"/>
    <site name="rod2" type="ellipsoid" size=".1 .05 .08" pos="-.3 0 .02"/>
  </body>
  <body name="disc" pos="0 .7 .05">
    <freejoint/>
    <geom name="disc" type="sphere" size=".06" condim="1"/>
    <site name="disc" type="sphere" size=".03" pos="0 0 -.05"/>
    <site name="disc2" type="cylinder" size=".03 .01" pos=".01 0 .1"/>
  </body>
  <body name="hung" pos="-2 1 1.2">
    <joint name="swing" axis="0 1 0" pos="0 0 .2"/>
    <geom name="hung" type="box" size=".1 .05 .2"/>
    <site name="hung" pos="0 .02 .25" euler="0 0 50"/>
  </body>
  <body name="door" pos="-1.4 0 1">
    <joint name="door" axis="0 0 1"/>
    <geom size=".1" pos=".2 0 0"/>
    <site name="door" pos="-.4 .05 .05"/>
  </body>
</worldbody>
<tendon>
  <fixed name="short" range="-.1 .2" limited="true" margin=".01">
    <joint joint="hinge" coef=".7"/><joint joint="slide" coef="-.4"/>
  </fixed>
  <fixed name="long"><joint joint="hinge" coef="1"/></fixed>
</tendon>
<equality>
  <weld body1="handle" body2="hung" torquescale="2"/>
  <weld site1="handle" site2="hung"/>
  <connect body1="door" body2="wall" anchor=".1 0 0.05"/>
  <connect site1="hinge" site2="door"/>
  <joint joint1="swing" joint2="door" polycoef="0 1 0 0 0"/>
</equality>
<actuator>
  <motor name="hinge" joint="hinge" gear="2"/>
  <position name="slide" joint="slide" kp="20"/>
  <motor name="short" tendon="short" gear="3"/>
  <velocity name="short2" tendon="short" kv="2"/>
  <motor name="long" tendon="long"/>
</actuator>
"""

OBJECTS = {
    "body": ("hand", "wall"),
    "xbody": ("plate", "arm"),
    "geom": ("base", "rod"),
    "site": ("hand", "fixed"),
}


def sensor_elements() -> list[str]:
    """MJCF of every supported sensor on many objects, with and without cutoffs."""
    rows = []
    sites = "fixed wall handle base arm plate hand rod".split()
    for kind in "magnetometer velocimeter gyro accelerometer force torque".split():
        rows += [f'<{kind} site="{site}"/>' for site in sites]
        rows.append(f'<{kind} site="hand" cutoff=".3"/>')
    rows += grid_elements()
    touched = "patch rod rod2 disc disc2 hand arm fixed".split()
    rows += [f'<touch site="{site}"/>' for site in touched] + ['<touch site="disc" cutoff="1"/>']
    rows += [f'<rangefinder site="{site}"/>' for site in sites]
    rows += ['<rangefinder site="arm" data="dist dir origin point normal depth"/>']
    rows += ['<rangefinder site="hand" data="dist normal" cutoff=".3"/>']
    rows += ['<camprojection site="rod" camera="eye"/>', '<rangefinder camera="eye"/>']
    for kind, geom in itertools.product(("distance", "normal", "fromto"), ("floor", "rod", "base")):
        rows.append(f'<{kind} geom1="{geom}" geom2="disc" cutoff="1"/>')
        rows.append(f'<{kind} body1="disc" body2="hand" cutoff=".2"/>')
    rows += contact_elements()
    for joint in ("hinge", "slide"):
        rows += [f'<joint{kind} joint="{joint}"/>' for kind in ("pos", "vel", "actuatorfrc")]
    rows += ['<ballquat joint="ball"/>', '<ballangvel joint="ball"/>']
    for kind, joint in itertools.product(("pos", "vel", "frc"), ("hinge", "slide", "ball")):
        rows.append(f'<jointlimit{kind} joint="{joint}"/>')
    rows += [f'<tendonlimit{kind} tendon="short"/>' for kind in ("pos", "vel", "frc")]
    for kind, tendon in itertools.product(("pos", "vel", "actuatorfrc"), ("short", "long")):
        rows.append(f'<tendon{kind} tendon="{tendon}"/>')
    for kind, name in itertools.product(("pos", "vel", "frc"), ("hinge", "short", "long")):
        rows.append(f'<actuator{kind} actuator="{name}"/>')
    for kind, body in itertools.product(
        ("com", "linvel", "angmom"), ("base", "arm", "wall", "rod")
    ):
        rows.append(f'<subtree{kind} body="{body}"/>')
    rows += [
        "<e_potential/>",
        "<e_kinetic/>",
        "<clock/>",
        '<clock cutoff=".01"/>',
        '<user dim="3"/>',
    ]
    return rows + frame_elements()


def grid_elements() -> list[str]:
    """MJCF of touch grids: two of equal shape, and one of a body whose geoms it is welded to."""
    rows = []
    for site, channels, size, gamma in (
        ("plate", 6, "4 3", 0.4),
        ("rod", 3, "5 2", 0),
        ("disc", 3, "5 2", 0),
        ("arm", 0, "1 1", 0),
    ):
        values = {"nchannel": channels, "size": size, "fov": "180 90", "gamma": gamma}
        config = "".join(f'<config key="{k}" value="{v}"/>' for k, v in values.items())
        kind = 'plugin="mujoco.sensor.touch_grid" objtype="site"'
        rows.append(f'<plugin {kind} objname="{site}">{config}</plugin>')
    return rows


def contact_elements() -> list[str]:
    """MJCF of contact sensors on all kinds of objects, with all data and all ways to reduce."""
    data = "found force torque dist pos normal tangent"
    ends = ('geom1="base"', 'geom2="disc"', 'body1="rod" geom2="floor"', 'subtree2="arm"', "")
    ends += ('geom1="floor" subtree2="base"', 'subtree1="base" geom2="floor"', 'site="fixed"')
    rows = ['<contact geom1="rod"/>', '<contact body2="disc" data="force normal" cutoff=".1"/>']
    for end in ends:
        rows.append(f'<contact {end} data="{data}" reduce="netforce"/>')
        rows.append(f'<contact {end} data="{data} linvel angvel" num="3"/>')
        rows.append(f'<contact {end} data="{data}" reduce="mindist" num="2"/>')
        rows.append(f'<contact {end} data="{data} angvel" reduce="maxforce"/>')
    return rows


def frame_elements() -> list[str]:
    """MJCF of the sensors of frames, for every kind of object and of reference."""
    rows = []
    kinds = "pos quat xaxis yaxis zaxis linvel angvel linacc angacc".split()
    for kind, objtype in itertools.product(kinds, OBJECTS):
        rows += [f'<frame{kind} objtype="{objtype}" objname="{n}"/>' for n in OBJECTS[objtype]]
        if kind in ("linacc", "angacc"):
            continue
        # One kind of reference each, so that over all sensors every pair of kinds occurs.
        shift = kinds.index(kind) + list(OBJECTS).index(objtype)
        reftype = list(OBJECTS)[shift % len(OBJECTS)]
        ref = f'reftype="{reftype}" refname="{OBJECTS[reftype][0]}"'
        rows.append(f'<frame{kind} objtype="{objtype}" objname="{OBJECTS[objtype][1]}" {ref}/>')
    rows.append('<framepos objtype="site" objname="base" cutoff=".2"/>')
    for objtype, site in itertools.product(OBJECTS, ("fixed", "arm", "hand", "rod", "disc")):
        name = OBJECTS[objtype][0]
        rows.append(f'<insidesite objtype="{objtype}" objname="{name}" site="{site}"/>')
    return rows


@pytest.fixture(scope="session")
def menagerie() -> mujoco.MjModel:
    """The model of everything, in an order of sensors that mixes all types and stages."""
    elements = sensor_elements()
    order = np.random.default_rng(3).permutation(len(elements))
    sensors = "".join(elements[i] for i in order)
    options = '<option timestep=".005" magnetic="1 -2 .5"/><compiler autolimits="true"/>'
    return mujoco.MjModel.from_xml_string(
        f"<mujoco>{options}{WORLD}<sensor>{sensors}</sensor></mujoco>"
    )


@pytest.fixture(scope="session")
def signals():
    """Function from a model and a record to `Signals`; may be traced."""
    return _signals


def _signals(model, values) -> Signals:
    dtype = model.qpos0.dtype
    contact = values["contact"]
    contact = contact.replace(
        pos=jnp.asarray(contact.pos, dtype), frame=jnp.asarray(contact.frame, dtype)
    )
    v = {k: jnp.asarray(x, dtype) for k, x in values.items() if k != "contact"}
    kin = kinematics(model, v["qpos"], v["mocap_pos"], v["mocap_quat"])
    wrench = external_wrench(
        model, kin, v["xfrc_applied"], contact, v["contact_force"], v["eq_force"]
    )
    same = "qacc energy time qfrc_actuator actuator_length actuator_velocity "
    same += "actuator_force contact_force joint_limit_force tendon_limit_force"
    return Signals(
        motion=Motion(model, v["qpos"], v["qvel"], kin, velocities(model, kin, v["qvel"])),
        tendon_length=v["ten_length"],
        tendon_velocity=v["ten_velocity"],
        body_wrench=wrench,
        contact=contact,
        **{name: v[name] for name in same.split()},
    )
