"""Numbers that no mechanism has: every message names the element and its attribute."""

import jax
import mujoco
import numpy as np
import pytest

from jaxsim.io import load
from jaxsim.model import ModelError

XML = """<mujoco>
  <worldbody>
    <body name="link">
      <joint name="hinge"/>
      <geom name="ball" size=".1"/>
      <body name="slider" pos="1 0 0">
        <joint name="slide" type="slide"/><geom name="end" size=".1"/>
      </body>
    </body>
  </worldbody>
  <contact><pair name="touch" geom1="ball" geom2="end"/></contact>
  <tendon><fixed name="cable"><joint joint="hinge" coef="1"/></fixed></tendon>
</mujoco>"""

# Edits of a compiled model.
EDITS = {
    "negative mass": ("body_mass", (1,), -1, "body 'link': mass must not be negative"),
    "negative inertia": ("body_inertia", (1, 0), -1, "body 'link': inertia must not be negative"),
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
        "body 'link': mass is not finite",
    ),
    "infinite size": ("geom_size", (1, 0), np.inf, "geom .*: size is not finite"),
    "stiffness that is not a number": (
        "jnt_stiffness",
        (1,),
        np.nan,
        "joint 'slide': stiffness is not finite",
    ),
    "position that is not a number": ("qpos0", (0,), np.nan, "joint 'hinge': qpos0 is not finite"),
}
NEGATIVE = {
    "dof_frictionloss": "joint 'slide': frictionloss must not be negative",
    "body_gravcomp": "body 'slider': gravcomp must not be negative",
    "geom_gap": "geom 'end': gap must not be negative",
    "geom_adhesion": "geom 'end': adhesion must not be negative",
    "pair_gap": "pair 'touch': gap must not be negative",
    "tendon_frictionloss": "tendon 'cable': frictionloss must not be negative",
}


@pytest.mark.parametrize("edit", EDITS)
def test_impossible_physics(edit):
    field, index, value, message = EDITS[edit]
    mj = mujoco.MjModel.from_xml_string(XML)
    getattr(mj, field)[index] = value
    _refused(mj, message)


@pytest.mark.parametrize("timestep", [0.0, -0.01])
def test_timestep_must_be_positive(timestep):
    mj = mujoco.MjModel.from_xml_string(XML)
    mj.opt.timestep = timestep
    _refused(mj, "option: timestep must be positive, got")


@pytest.mark.parametrize("medium", ["density", "viscosity"])
def test_a_medium_must_not_be_negative(medium):
    mj = mujoco.MjModel.from_xml_string(XML)
    setattr(mj.opt, medium, -0.1)
    _refused(mj, f"option: {medium} must not be negative")


def test_gravity_must_be_finite():
    mj = mujoco.MjModel.from_xml_string(XML)
    mj.opt.gravity[1] = np.nan
    _refused(mj, "option: gravity is not finite")


def test_moving_body_needs_inertia():
    mj = mujoco.MjModel.from_xml_string(XML)
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


def test_slides_along_one_axis_are_refused():
    """MuJoCo takes the mass matrix of such a body for diagonal."""
    xml = """<mujoco><worldbody><body><geom size="1"/><joint name="j" type="slide" axis="1 0 0"/>
      <joint type="slide" axis="1 0 0" {}/></body></worldbody></mujoco>"""
    _refused(xml.format(""), "joint 'j': the mass matrix is singular at qpos0; remove")
    assert load(xml.format('armature="1"')).nv == 2


AXES = ("1 0 0", "0 1 0", "0 0 1", "1 1 0")


@pytest.mark.parametrize("field", NEGATIVE)
def test_negative_numbers(field):
    mj = mujoco.MjModel.from_xml_string(XML)
    getattr(mj, field)[-1] = -1
    _refused(mj, NEGATIVE[field])


def test_an_element_without_a_name_is_found_by_its_body():
    mj = mujoco.MjModel.from_xml_string(XML.replace('name="slide"', ""))
    mj.dof_frictionloss[1] = -1
    _refused(mj, "joint number 1 of body 'slider': frictionloss must not be negative")


@pytest.mark.parametrize("x64", [False, True])
def test_flat_bodies_are_not_refused_because_of_rounding(x64):
    with jax.enable_x64(x64):
        xml = """<mujoco><worldbody><body><freejoint/>
          <inertial pos="0 0 0" mass="1" diaginertia="0.1 0.2 0.3"/></body></worldbody></mujoco>"""
        assert load(xml).nv == 6


def _refused(source, message: str):
    with pytest.raises(ModelError, match=message) as caught:
        load(source)
    text = str(caught.value)
    assert "\n" not in text
    assert not text.endswith(".")
