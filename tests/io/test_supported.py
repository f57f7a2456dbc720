"""What a model may not ask for: every message names the element and says what would work."""

import jax
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.collision.table import CYLINDER, PAIRS
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
    '<option integrator="discrete"/>': "option: integrator 'discrete' .* euler, rk4",
}

ELEMENTS = {
    '<actuator><general name="m" joint="hinge" dyntype="user" actdim="1"/></actuator>': (
        "actuator 'm': dyntype 'user' .* none, integrator, filter"
    ),
    '<actuator><general name="m" joint="hinge" gaintype="user"/></actuator>': (
        "actuator 'm': gaintype 'user' .* fixed, affine, muscle"
    ),
    '<actuator><general name="m" joint="hinge" biastype="user"/></actuator>': (
        "actuator 'm': biastype 'user' .* none, affine, muscle"
    ),
    """<deformable><flex name="f" dim="1" body="link slider" vertex="0 0 0 0 0 0" element="0 1"/>
       </deformable>""": "flex elements .* remove them",
}


@pytest.mark.parametrize("options", OPTIONS)
def test_unsupported_option(options):
    _refused(_xml(options=options), OPTIONS[options])


@pytest.mark.parametrize("element", ELEMENTS)
def test_unsupported_element(element):
    _refused(_xml(rest=element), ELEMENTS[element])


@pytest.mark.parametrize(
    ("field", "message"),
    [
        ("jnt_type", "joint 'hinge': type 'number 77' is not supported"),
        ("geom_type", "geom 'ball' and geom 'other': sphere and number 77 may"),
        ("actuator_dyntype", "actuator 'm': dyntype 'number 77'"),
        ("sensor_type", "sensor 's': type 'number 77'"),
        ("eq_type", "equality 'e': type 'number 77'"),
    ],
)
def test_types_of_a_later_mujoco_are_refused_by_number(field, message):
    rest = """<actuator><motor name="m" joint="hinge"/></actuator>
      <sensor><jointpos name="s" joint="hinge"/></sensor>
      <equality><joint name="e" joint1="hinge"/></equality>"""
    mj = mujoco.MjModel.from_xml_string(_xml(rest=rest))
    getattr(mj, field)[0] = 77
    with pytest.raises(ModelError, match=message):
        load(mj)


def test_flags_of_a_later_mujoco_are_refused_by_number():
    mj = mujoco.MjModel.from_xml_string(_xml())
    mj.opt.enableflags |= 1 << 20
    _refused(mj, "option flag: number 1048576 is not supported; disable it")


def test_all_reasons_are_listed_and_equal_ones_once():
    user = 'joint="hinge" dyntype="user" actdim="1"'
    rest = "".join(f'<general name="u{i}" {user}/>' for i in range(5))
    options, rest = '<option integrator="discrete"/>', f"<actuator>{rest}</actuator>"
    with pytest.raises(ModelError) as caught:
        load(_xml(options, 'adhesion="-1"', rest))
    integrator, user, adhesion = caught.value.problems
    assert str(caught.value).startswith("3 things in the model are wrong or not supported:\n- opt")
    assert integrator.startswith("option: integrator")
    assert user.startswith("actuator 'u0', actuator 'u1', actuator 'u2' and 2 more: dyntype 'user'")
    assert adhesion.startswith("geom 'ball': adhesion must not be negative")


@pytest.mark.parametrize(
    ("options", "geom", "rest"),
    [
        ('<option><flag sleep="enable"/></option>', "", ""),
        ("", 'fluidshape="ellipsoid"', ""),
        ("", "", '<actuator><motor joint="hinge" nsample="4"/></actuator>'),
        ("", "", '<sensor><jointpos joint="hinge" nsample="4"/></sensor>'),
    ],
)
def test_what_has_no_effect_is_accepted(options, geom, rest, x64):
    mj = mujoco.MjModel.from_xml_string(_xml(options, geom, rest))
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    model = load(mj)
    now = quick_jit(jaxsim.forward)(model, jaxsim.make_state(model))
    np.testing.assert_allclose(now.qacc, data.qacc, atol=1e-9)
    np.testing.assert_allclose(now.sensordata, data.sensordata, atol=1e-9)


def test_rendering_passes_silently():
    rest = '<asset><texture type="skybox" builtin="flat" width="8" height="8"/></asset>'
    options = '<visual><global fovy="50"/></visual><statistic extent="2"/>'
    assert load(_xml(options=options, rest=rest)).njnt == 2


def _xml(options: str = "", geom: str = "", rest: str = "") -> str:
    return BASE.format(options=options, geom=geom, rest=rest)


def _refused(source, message: str):
    with pytest.raises(ModelError, match=message) as caught:
        load(source)
    text = str(caught.value)
    assert "\n" not in text
    assert not text.endswith(".")


CROWD = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
  <body pos="0 0 .09"><freejoint/><geom name="one" type="cylinder" size=".1 .1"/></body>
  <body pos="0 .2 .09"><freejoint/><geom name="two" type="cylinder" size=".11 .1"/></body>
</worldbody>{}</mujoco>"""


@pytest.fixture
def no_cylinders(monkeypatch):
    """As if two cylinders had no pair function."""
    monkeypatch.delitem(PAIRS, (CYLINDER, CYLINDER))


def test_unsupported_pairs_are_dropped_where_that_is_asked_for(x64, no_cylinders):
    with pytest.raises(ModelError, match="geom 'one' and geom 'two': cylinder and cylinder may"):
        load(CROWD.format(""))
    with pytest.warns(UserWarning, match="pass through each other: geom 'one' and geom 'two'$"):
        model = load(CROWD.format(""), unsupported_pairs="drop")
    exclude = '<contact><exclude body1="a" body2="b"/></contact>'
    without = CROWD.replace('<body pos="0 0', '<body name="a" pos="0 0')
    without = load(without.replace('<body pos="0 .2', '<body name="b" pos="0 .2').format(exclude))
    got, expected = (
        quick_jit(jaxsim.forward)(m, jaxsim.make_state(m)).qacc for m in (model, without)
    )
    assert abs(got).max() > 1
    np.testing.assert_array_equal(got, expected)


def test_pairs_are_dropped_only_if_that_is_asked_for(no_cylinders):
    """Contacts that a flag switched off, and that come back, are no others."""
    model = load(CROWD.format('<option><flag contact="disable"/></option>'))
    back = model.replace(opt=model.opt.replace(disableflags=0))
    with pytest.raises(ModelError, match="cylinder and cylinder may collide"):
        jax.eval_shape(jaxsim.step, back, jaxsim.make_state(model))
    with pytest.raises(ValueError, match="unsupported_pairs must be error or drop, got 'ignore'"):
        load(CROWD, unsupported_pairs="ignore")
