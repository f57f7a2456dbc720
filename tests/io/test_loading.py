"""Loading from everything that `load` takes."""

import pathlib

import mujoco
import numpy as np
import pytest

from jaxsim.io import bundled_models, load
from jaxsim.model import ModelError

XML = """<mujoco model="one"><worldbody><body name="link"><joint/><geom size=".1"/></body>
  </worldbody></mujoco>"""
URDF = """<robot name="arm"><link name="base"/>
  <link name="tip"><inertial><mass value="2"/><origin xyz="0 0 1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="elbow" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="10" velocity="10"/></joint></robot>"""


def test_from_xml_string():
    assert load(XML).names.id("body", "link") == 1
    assert load("\n  " + XML).nv == 1


def test_from_urdf_string():
    model = load(URDF)
    assert model.names.name("joint", 0) == "elbow"
    np.testing.assert_allclose(model.jnt_range, [[-1, 1]])


@pytest.mark.parametrize(("suffix", "text"), [("xml", XML), ("mjcf", XML), ("urdf", URDF)])
@pytest.mark.parametrize("kind", [str, pathlib.Path])
def test_from_file(tmp_path, suffix, text, kind):
    path = tmp_path / f"model.{suffix}"
    path.write_text(text)
    assert load(kind(path)).nv == 1


def test_from_spec_and_from_compiled_model():
    spec = mujoco.MjSpec.from_string(XML)
    assert load(spec).nv == load(spec.compile()).nv == 1


def test_from_bundled_name():
    assert "pendulum" in bundled_models()
    assert load("pendulum").nv == 1


def test_file_wins_over_bundled_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    pathlib.Path("pendulum").write_text(XML)
    assert load("pendulum").names.id("body", "link") == 1


@pytest.mark.parametrize(
    ("name", "hint"),
    [("pendulm", "did you mean pendulum"), ("nowhere/x.xml", "bundled models are acrobot, ant")],
)
def test_missing_file(name, hint):
    with pytest.raises(FileNotFoundError, match=f"called '{name}'; {hint}"):
        load(name)


@pytest.mark.parametrize(
    "text",
    [
        "<mujoco><worldbody>",
        "<mujoco><worldbody><body><joint/></body></worldbody></mujoco>",
        '<mujoco><worldbody><geom size="-1"/></worldbody></mujoco>',
        "<html></html>",
    ],
)
def test_malformed_xml(text):
    with pytest.raises(ModelError, match="MuJoCo cannot compile the XML string: ") as caught:
        load(text)
    assert "\n" not in str(caught.value)


BYTE_ORDER_MARK = "\ufeff"


def test_a_byte_order_mark_is_no_file_name():
    assert load(BYTE_ORDER_MARK + XML).nv == 1


def test_names_in_latin_1(tmp_path):
    path = tmp_path / "cafe.xml"
    path.write_bytes(XML.replace("link", "caf\xe9").encode("latin-1"))
    assert load(path).names.id("body", "caf\xe9") == 1


def test_a_name_longer_than_a_file_may_have():
    with pytest.raises(FileNotFoundError, match="no file and no bundled model"):
        load("a" * 5000)


def test_what_mujoco_cannot_allocate_is_a_model_error(monkeypatch):
    def refuse(text):
        raise MemoryError

    monkeypatch.setattr(mujoco.MjModel, "from_xml_string", refuse)
    with pytest.raises(ModelError, match="cannot compile the XML string: MemoryError"):
        load(XML)


def test_malformed_file_is_named(tmp_path):
    path = tmp_path / "broken.xml"
    path.write_text("<mujoco>")
    with pytest.raises(ModelError, match=r"cannot compile .*broken\.xml: "):
        load(path)


def test_spec_that_does_not_compile():
    spec = mujoco.MjSpec.from_string(XML)
    spec.worldbody.add_body().add_joint()
    with pytest.raises(ModelError, match="cannot compile the MjSpec: "):
        load(spec)


@pytest.mark.parametrize("source", [3, None, b"<mujoco/>", [XML]])
def test_other_types(source):
    with pytest.raises(TypeError, match=f"load takes a path, .* got {type(source).__name__}"):
        load(source)


def test_unknown_strategy_for_the_hessian():
    with pytest.raises(ValueError, match=r"hessian must be one of auto, .* got 'fast'"):
        load(XML, hessian="fast")
