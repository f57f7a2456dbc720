"""Passive forces, actuators and integrators against MuJoCo, with constraints switched off."""

import jax
import mujoco
import numpy as np
import pytest
from assets import asset_files
from smooth_models import FLUID, arm, kitchen_sink
from smooth_stages import compare

from jaxsim.io import load
from jaxsim.model import ModelError

FILES = asset_files()
# Between them: fluid, tendons, muscles, activation dynamics, all transmissions.
SAMPLE = ("brax:swimmer.xml", "brax:pusher.xml", "mujoco.mjx:actuator/general_dyntype.xml")
SINGLE = ("mujoco.mjx:tendon/fixed.xml",)
FLAGS = ("ACTUATION", "CLAMPCTRL", "DAMPER", "EULERDAMP", "GRAVITY", "SPRING")


@pytest.mark.parametrize(
    "name", [n if n in SAMPLE else pytest.param(n, marks=pytest.mark.slow) for n in FILES]
)
def test_models_of_other_packages(name):
    _compare_file(name, precision=0)


@pytest.mark.parametrize(
    "name", [n if n in SINGLE else pytest.param(n, marks=pytest.mark.slow) for n in FILES]
)
def test_models_of_other_packages_in_float32(name):
    with jax.enable_x64(False):
        _compare_file(name, precision=1)


@pytest.mark.parametrize(
    ("integrator", "option"),
    [
        ("Euler", ""),
        ("implicitfast", FLUID),
        pytest.param("implicit", FLUID, marks=pytest.mark.slow),
        pytest.param("implicitfast", 'actuatorgroupdisable="2"', marks=pytest.mark.slow),
    ],
)
def test_all_forces_together(integrator, option):
    compare(mujoco.MjModel.from_xml_string(kitchen_sink(integrator, option)))


def test_implicit_integration_along_the_tree():
    actuators = '<velocity joint="hinge" kv="3"/><position joint="left" kp="2" kv="1"/>'
    xml = kitchen_sink("implicitfast", FLUID, actuators, tendon_damping=False)
    compare(mujoco.MjModel.from_xml_string(xml))


@pytest.mark.parametrize("integrator", ["Euler", "RK4", "implicit", "implicitfast"])
def test_integrators_without_rotations(integrator):
    compare(mujoco.MjModel.from_xml_string(arm(integrator)))


def test_undamped_euler():
    compare(mujoco.MjModel.from_xml_string(arm("Euler", damping=0)))


@pytest.mark.parametrize("flags", [*((flag,) for flag in FLAGS), ("SPRING", "DAMPER")])
def test_disable_flags(flags):
    mj = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option {FLUID}/><worldbody><body gravcomp=".5">
        <joint name="a" axis="0 1 0" stiffness="2" damping="1" actuatorgravcomp="true"/>
        <geom size=".1" pos=".3 0 0"/><body gravcomp=".3" pos=".3 0 0">
        <joint name="b" axis="0 1 0" damping="1"/><geom size=".1" pos=".3 0 0"/></body></body>
        </worldbody><actuator><general joint="a" ctrlrange="-.1 .1" dyntype="integrator"/>
        <motor joint="b" ctrlrange="-.1 .1"/></actuator></mujoco>"""
    )
    for flag in flags:
        mj.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
    compare(mj)


def test_gravity_compensation_of_actuators_needs_an_actuator():
    mj = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body gravcomp="1"><joint axis="0 1 0" actuatorgravcomp="true"/>
        <geom size=".1" pos=".3 0 0"/></body></worldbody></mujoco>"""
    )
    compare(mj)


def test_a_model_without_degrees_of_freedom():
    compare(mujoco.MjModel.from_xml_string("<mujoco><worldbody/></mujoco>"))


def _compare_file(name: str, precision: int):
    mj = mujoco.MjModel.from_xml_path(str(FILES[name]))
    try:
        load(mj)
    except ModelError:
        return
    rotations = np.isin(mj.jnt_type, (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL))
    # Ours has fourth order for rotations too, so there the two differ.
    differs = mj.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4 and rotations.any()
    if differs:
        mj.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    compare(mj, precision)
