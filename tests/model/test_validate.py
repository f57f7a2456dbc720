"""What a model may not ask for: every message names the element and says what would work."""

import jax
import mujoco
import numpy as np
import pytest

from jaxsim.io import load
from jaxsim.model import ModelError

BASE = """<mujoco>{options}
  <worldbody>
    <body name="link">
      <joint name="hinge"/>
      <geom name="ball" size=".1" {geom}/>
      <site name="tip" pos="0 0 1"/>
      <body name="slider" pos="1 0 0"><joint name="slide" type="slide"/><geom size=".1"/></body>
    </body>
    <site name="anchor" pos="0 0 2"/>
    <geom name="other" size=".1" pos="0 0 5"/>
  </worldbody>{rest}
</mujoco>"""

OPTIONS = {
    '<option noslip_iterations="3"/>': "option: noslip_iterations .* use impratio",
    '<option><flag invdiscrete="enable"/></option>': "option flag: invdiscrete .* disable it",
    '<option><flag sleep="enable"/></option>': "option flag: sleep .* disable it",
    '<option><flag diagexact="enable"/></option>': "option flag: diagexact .* disable it",
}

GEOMS = {
    'fluidshape="ellipsoid"': "geom 'ball': fluidshape .* inertia-box",
    'surfacevel="1 0 0"': "geom 'ball': surfacevel .* remove",
    'adhesion="1"': "geom 'ball': adhesion .* remove",
}

FIXED = '<tendon><fixed name="cable"{}><joint joint="hinge" coef="1"/></fixed></tendon>'
SPATIAL = '<tendon><spatial name="cable"><site site="tip"/><site site="anchor"/></spatial></tendon>'

ELEMENTS = {
    SPATIAL: "tendon 'cable': spatial tendons .* fixed tendon",
    FIXED.format(' armature="1"'): "tendon 'cable': armature .* joints",
    FIXED.format("") + '<actuator><motor name="m" tendon="cable" armature="1"/></actuator>': (
        "actuator 'm': armature of a tendon's actuator .* joints"
    ),
    '<actuator><adhesion name="m" body="link" ctrlrange="0 1"/></actuator>': (
        "actuator 'm': transmission 'body' .* joint, jointinparent, tendon, site"
    ),
    """<actuator><general name="m" cranksite="tip" slidersite="anchor" cranklength="1"/>
       </actuator>""": "actuator 'm': transmission 'slidercrank' .* joint, jointinparent",
    '<actuator><general name="m" joint="hinge" dyntype="user" actdim="1"/></actuator>': (
        "actuator 'm': dyntype 'user' .* none, integrator, filter"
    ),
    '<actuator><general name="m" joint="hinge" gaintype="user"/></actuator>': (
        "actuator 'm': gaintype 'user' .* fixed, affine, muscle"
    ),
    '<actuator><general name="m" joint="hinge" biastype="user"/></actuator>': (
        "actuator 'm': biastype 'user' .* none, affine, muscle"
    ),
    '<actuator><motor name="m" joint="hinge" nsample="4" delay="0.01"/></actuator>': (
        "actuator 'm': delay .* remove"
    ),
    '<actuator><motor name="m" joint="hinge" nsample="4"/></actuator>': (
        "actuator 'm': history .* remove"
    ),
    '<sensor><rangefinder name="s" site="tip"/></sensor>': "sensor 's': type 'rangefinder'",
    '<sensor><distance name="s" geom1="ball" geom2="other"/></sensor>': (
        "sensor 's': type 'geomdist'"
    ),
    '<sensor><normal name="s" geom1="ball" geom2="other"/></sensor>': (
        "sensor 's': type 'geomnormal'"
    ),
    '<sensor><fromto name="s" geom1="ball" geom2="other"/></sensor>': (
        "sensor 's': type 'geomfromto'"
    ),
    '<sensor><contact name="s" geom1="ball"/></sensor>': "sensor 's': type 'contact'",
    '<sensor><user name="s" dim="1"/></sensor>': "sensor 's': type 'user'",
    '<sensor><jointpos name="s" joint="hinge" nsample="3"/></sensor>': "sensor 's': history",
    """<deformable><flex name="f" dim="1" body="link slider" vertex="0 0 0 0 0 0" element="0 1"/>
       </deformable>""": "flex elements .* remove them",
}

# Edits of a compiled model that make it physically impossible.
EDITS = {
    "negative mass": ("body_mass", (1,), -1, "body 'link': mass and inertia must not be negative"),
    "negative inertia": ("body_inertia", (1, 0), -1, "body 'link': mass and inertia"),
    "triangle inequality": (
        "body_inertia",
        (1, 0),
        9,
        "body 'link': inertia .* breaks the triangle inequality",
    ),
    "mass that is not a number": (
        "body_mass",
        (1,),
        np.nan,
        "body 'link': body_mass is not finite",
    ),
    "infinite size": ("geom_size", (1, 0), np.inf, "geom .*: geom_size is not finite"),
    "stiffness that is not a number": (
        "jnt_stiffness",
        (1,),
        np.nan,
        "joint 'slide': jnt_stiffness is not finite",
    ),
    "position that is not a number": ("qpos0", (0,), np.nan, "entry 0: qpos0 is not finite"),
}


@pytest.mark.parametrize("options", OPTIONS)
def test_unsupported_option(options):
    _refused(_xml(options=options), OPTIONS[options])


@pytest.mark.parametrize("geom", GEOMS)
def test_unsupported_geom_attribute(geom):
    _refused(_xml(geom=geom), GEOMS[geom])


@pytest.mark.parametrize("element", ELEMENTS)
def test_unsupported_element(element):
    _refused(_xml(rest=element), ELEMENTS[element])


@pytest.mark.parametrize("edit", EDITS)
def test_impossible_physics(edit):
    field, index, value, message = EDITS[edit]
    mj = mujoco.MjModel.from_xml_string(_xml())
    getattr(mj, field)[index] = value
    _refused(mj, message)


@pytest.mark.parametrize("timestep", [0.0, -0.01])
def test_timestep_must_be_positive(timestep):
    mj = mujoco.MjModel.from_xml_string(_xml())
    mj.opt.timestep = timestep
    _refused(mj, "option: timestep must be positive, got")


def test_gravity_must_be_finite():
    mj = mujoco.MjModel.from_xml_string(_xml())
    mj.opt.gravity[1] = np.nan
    _refused(mj, "option: gravity is not finite")


def test_moving_body_needs_inertia():
    mj = mujoco.MjModel.from_xml_string(_xml())
    mj.body_mass[2], mj.body_inertia[2] = 0, 0
    _refused(mj, "body 'slider': a moving body needs mass, or armature")
    mj.dof_armature[1] = 0.1
    assert load(mj).nv == 2


def test_joints_that_undo_each_other_are_refused():
    xml = """<mujoco><worldbody><body><geom size="1"/>{}</body></worldbody></mujoco>"""
    slides = [f'<joint name="j{i}" type="slide" axis="{a}" {{}}/>' for i, a in enumerate(AXES)]
    xml = xml.format("".join(slides))
    _refused(xml.format(*4 * [""]), "joint 'j0': the mass matrix is singular at qpos0; remove")
    assert load(xml.format(*4 * ['armature="1"'])).nv == 4


AXES = ("1 0 0", "0 1 0", "0 0 1", "1 1 0")


def test_rendering_passes_silently():
    rest = '<asset><texture type="skybox" builtin="flat" width="8" height="8"/></asset>'
    options = '<visual><global fovy="50"/></visual><statistic extent="2"/>'
    assert load(_xml(options=options, rest=rest)).njnt == 2


@pytest.mark.parametrize("x64", [False, True])
def test_flat_bodies_are_not_refused_because_of_rounding(x64):
    with jax.enable_x64(x64):
        xml = """<mujoco><worldbody><body><freejoint/>
          <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.2 0.3"/></body></worldbody></mujoco>"""
        assert load(xml).nv == 6


def _xml(options: str = "", geom: str = "", rest: str = "") -> str:
    return BASE.format(options=options, geom=geom, rest=rest)


def _refused(source, message: str):
    with pytest.raises(ModelError, match=message) as caught:
        load(source)
    text = str(caught.value)
    assert "\n" not in text
    assert not text.endswith(".")


def test_a_margin_that_activates_both_limits_is_refused():
    xml = """<mujoco><worldbody><body><geom size=".1"/>
      <joint name="knee" type="hinge" limited="true" range="-1 1" margin=".02"/>
    </body></worldbody></mujoco>"""
    with pytest.raises(ModelError, match="joint 'knee': margin 0.02 exceeds half of the range"):
        load(xml)


def test_a_sensor_of_a_camera_is_refused():
    xml = """<mujoco><worldbody><body><geom size=".1"/><camera name="eye"/></body></worldbody>
      <sensor><framepos name="where" objtype="camera" objname="eye"/></sensor></mujoco>"""
    with pytest.raises(ModelError, match="sensor 'where': sensors of cameras are not supported"):
        load(xml)
