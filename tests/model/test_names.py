"""Names of elements in both directions."""

import mujoco
import pytest

from jaxsim.io import load
from jaxsim.model.names import KINDS

XML = """<mujoco>
  <worldbody>
    <camera name="eye"/>
    <body name="thigh"><joint name="hip"/><geom name="skin" size=".1"/><site name="tip"/>
      <body name="shin"><joint name="knee"/><geom name="foot" size=".1"/></body>
    </body>
  </worldbody>
  <contact>
    <pair name="touch" geom1="skin" geom2="foot"/>
    <exclude name="no" body1="thigh" body2="shin"/>
  </contact>
  <tendon><fixed name="cable"><joint joint="hip" coef="1"/></fixed></tendon>
  <equality><joint name="equal" joint1="hip" joint2="knee"/></equality>
  <actuator><motor name="motor" joint="hip"/></actuator>
  <sensor><jointpos name="angle" joint="hip"/></sensor>
  <keyframe><key name="home"/></keyframe>
</mujoco>"""


@pytest.fixture(scope="module")
def model():
    return load(XML)


def test_names_and_ids_are_those_of_mujoco(model):
    mj = mujoco.MjModel.from_xml_string(XML)
    for kind in KINDS:
        obj = getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}")
        assert len(model.names.of(kind)) > 0
        for i, name in enumerate(model.names.of(kind)):
            assert mujoco.mj_id2name(mj, obj, i) == name
            assert model.names.id(kind, name) == i
            assert model.names.name(kind, i) == name


def test_unnamed_elements_have_an_empty_name_and_a_label():
    names = load("<mujoco><worldbody><geom size='1'/></worldbody></mujoco>").names
    assert names.name("geom", 0) == ""
    assert names.label("geom", 0) == "geom number 0 of body 'world'"
    assert names.label("body", 0) == "body 'world'"


@pytest.mark.parametrize(
    ("kind", "name", "message"),
    [
        ("joint", "kne", "no joint named 'kne'; did you mean 'knee'"),
        ("body", "zzz", "no body named 'zzz'; its names are world, thigh, shin"),
        ("joint", "", "no joint named ''"),
        ("jiont", "knee", "no kind of element is called 'jiont'; the kinds are body, joint"),
    ],
)
def test_unknown_name(model, kind, name, message):
    with pytest.raises(KeyError, match=message):
        model.names.id(kind, name)


@pytest.mark.parametrize("index", [-1, 2])
def test_unknown_index(model, index):
    with pytest.raises(IndexError, match=f"2 elements of kind 'joint', got id {index}"):
        model.names.name("joint", index)


def test_elements_without_a_name_say_where_they_belong():
    names = load(
        """<mujoco><worldbody><body><joint name="hip"/><geom size=".1"/>
        <body><joint/><geom size=".1"/></body></body></worldbody>
        <actuator><motor joint="hip"/></actuator><sensor><jointpos joint="hip"/></sensor>
        <equality><joint joint1="hip"/></equality></mujoco>"""
    ).names
    assert names.label("joint", 1) == "joint number 1 of body number 2 of body number 1"
    assert names.label("geom", 0) == "geom number 0 of body number 1"
    for kind in ("actuator", "sensor", "equality"):
        assert names.label(kind, 0) == f"{kind} number 0 of joint 'hip'"
