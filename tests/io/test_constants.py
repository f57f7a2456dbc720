"""`set_const` against `mj_setConst`: of models as they were compiled, and after changes."""

import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from assets import UNSUPPORTED, asset_files
from oracle import quick_jit

import jaxsim
from jaxsim.io import bundled_models, bundled_xml

CONSTANTS = (
    "body_subtreemass body_invweight0 dof_invweight0 dof_M0 tendon_length0 tendon_invweight0 "
    "actuator_length0 actuator_acc0 cam_pos0 cam_poscom0 cam_mat0 eq_data"
).split()

SLIDES = """
<mujoco><worldbody>
  <body pos="0 0 1">{joints}<geom size=".1" mass="2"/></body>
  <body pos="1 0 1"><joint type="slide" axis="1 1 0"/><geom size=".1" mass="3"/></body>
</worldbody></mujoco>
"""
JOINED = """
<mujoco>
  <worldbody>
    <body name="a"><freejoint/><geom size=".05"/>
      <camera pos=".1 .2 .3" euler="10 20 30" mode="targetbody" target="b"/></body>
    <body name="b" pos=".1 0 .5" euler="10 20 30"><joint axis="0 1 0"/><geom size=".05"/>
      <body name="c" pos=".3 0 0" euler="0 40 0"><joint type="ball"/>
        <geom size=".1 .02" type="capsule"/></body>
    </body>
  </worldbody>
  <equality>
    <weld body1="a" body2="b" anchor=".1 .2 .3"/>
    <weld body1="a" body2="c" relpose="0 0 .1 1 0 0 0"/>
    <weld body1="c"/>
    <connect body1="b" body2="a" anchor="0 .1 .2"/>
  </equality>
</mujoco>
"""


SPATIAL = """
<mujoco>
  <worldbody>
    <site name="w" pos="-.1 .3 .4"/>
    <body pos="0 0 .2"><joint axis="0 1 0"/><geom name="g" type="cylinder" size=".05 .2"/>
      <body pos=".3 0 0"><joint axis="0 1 1"/><geom size=".05"/>
        <site name="s" pos="0 -.2 0"/></body>
    </body>
  </worldbody>
  <tendon><spatial name="t"><site site="w"/><geom geom="g"/><site site="s"/><pulley divisor="2"/>
    <site site="s"/><site site="w"/></spatial></tendon>
  <actuator><motor tendon="t" gear="3"/></actuator>
</mujoco>
"""


def compute(model):
    found = jaxsim.set_const(model)
    return {name: getattr(found, name) for name in CONSTANTS}


def compare(mj: mujoco.MjModel, found: dict, what: str) -> None:
    for name in CONSTANTS:
        expected = getattr(mj, name)
        scale = max(1.0, np.abs(expected).max(initial=0))
        np.testing.assert_allclose(
            found[name] / scale, expected / scale, atol=1e-12, err_msg=f"{what}: {name}"
        )


def changes(mj: mujoco.MjModel, rng) -> dict[str, np.ndarray]:
    """Another value of each field from which constants are computed."""
    grown = lambda x: x * rng.uniform(1.1, 1.5, size=x.shape)  # noqa: E731
    values = {
        name: grown(getattr(mj, name))
        for name in ("body_mass", "dof_armature", "wrap_prm", "actuator_gear")
    }
    # Of a surface that a tendon wraps around, it is the number of the side site.
    surface = np.isin(mj.wrap_type, (mujoco.mjtWrap.mjWRAP_SPHERE, mujoco.mjtWrap.mjWRAP_CYLINDER))
    values["wrap_prm"] = np.where(surface, mj.wrap_prm, values["wrap_prm"])
    # Larger moments of all axes at once keep the triangle inequality.
    values["body_inertia"] = mj.body_inertia * rng.uniform(1.1, 1.5, size=(mj.nbody, 1))
    values["body_pos"] = mj.body_pos + rng.normal(scale=0.05, size=mj.body_pos.shape)
    values["body_pos"][0] = 0
    return values


def check(mj: mujoco.MjModel, rng) -> None:
    model, run = jaxsim.load(mj), quick_jit(compute)
    compare(mj, run(model), "unchanged")
    for field, value in changes(mj, rng).items():
        before = getattr(mj, field).copy()
        getattr(mj, field)[:] = value
        mujoco.mj_setConst(mj, mujoco.MjData(mj))
        compare(mj, run(model.replace(**{field: jnp.asarray(value)})), field)
        getattr(mj, field)[:] = before


@pytest.mark.parametrize(
    "axes", [["0 0 1"], ["1 0 0", "0 0 1"], ["0 1 0", "1 0 0", "0 0 1"]], ids=len
)
def test_bodies_that_only_slide(axes, x64, rng):
    joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in axes)
    mj = mujoco.MjModel.from_xml_string(SLIDES.format(joints=joints))
    assert mj.body_simple.tolist() == [1, 2, 0]
    check(mj, rng)


def test_connects_and_welds_keep_the_reference_configuration(x64, rng):
    check(mujoco.MjModel.from_xml_string(JOINED), rng)


def test_spatial_tendons(x64, rng):
    check(mujoco.MjModel.from_xml_string(SPATIAL), rng)


@pytest.mark.parametrize("name", ["four_bar", "arm"])
def test_bundled_models(name, x64, rng):
    check(mujoco.MjModel.from_xml_string(bundled_xml(name)), rng)


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_models())
def test_all_bundled_models(name, x64, rng):
    check(mujoco.MjModel.from_xml_string(bundled_xml(name)), rng)


@pytest.mark.slow
@pytest.mark.parametrize("path", asset_files().values(), ids=asset_files().keys())
def test_models_of_other_packages(path, x64, rng):
    mj = mujoco.MjModel.from_xml_path(str(path))
    reason = ""
    try:
        check(mj, rng)
    except jaxsim.ModelError as error:
        reason = str(error)
    assert not reason or any(known in reason for known in UNSUPPORTED)
