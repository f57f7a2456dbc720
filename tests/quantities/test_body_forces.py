"""Com-based inertias, accelerations and forces of bodies, and wrenches from outside."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco_records import record, rollout

from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.rnea import project_wrench
from jaxsim.dynamics.velocity import velocities
from jaxsim.forces.external import external_wrench
from jaxsim.io import build
from jaxsim.quantities import body_forces

XML = """
<mujoco><option timestep=".002"/><worldbody>
  <geom type="plane" size="5 5 1"/>
  <body name="post" pos="1 0 .5" euler="10 20 0">
    <geom type="box" size=".05 .05 .2"/><site name="post" pos="0 .1 0" euler="0 0 30"/>
  </body>
  <body name="handle" mocap="true" pos="-1 0 1"/>
  <body name="box" pos="0 0 .1"><freejoint/>
    <geom type="box" size=".2 .15 .1" euler="0 0 20"/>
    <body name="arm" pos="0 0 .2"><joint axis="0 1 .3"/>
      <geom type="capsule" size=".04" fromto="0 0 0 .1 .2 .3" contype="0" conaffinity="0"/>
      <body name="tip" pos=".1 .2 .3" euler="0 40 0"><geom size=".06"/></body>
    </body>
  </body>
  <body name="ball" pos="0 1 .09"><freejoint/><geom size=".1" condim="6"/></body>
  <body name="hung" pos="-1 0 .8"><freejoint/><geom type="box" size=".05 .1 .15"/></body>
  <body name="lamp" pos="1 .2 .5"><joint type="ball"/><geom size=".05" pos="0 .1 .1"/>
    <site name="lamp" pos="0 -.1 0.02" euler="0 30 0"/></body>
</worldbody><equality>
  <weld body1="handle" body2="hung" torquescale="1.5" anchor=".02 0 .1"/>
  <weld site1="post" site2="lamp"/>
  <connect body1="ball" body2="box" anchor="0 -.1 0"/>
</equality></mujoco>
"""


@pytest.fixture(scope="module")
def scene():
    mj = mujoco.MjModel.from_xml_string(XML)
    return mj, [(d, record(mj, d)) for d in rollout(mj, count=3, every=8)]


@jax.jit
def _quantities(model, v):
    kin = kinematics(model, v["qpos"], v["mocap_pos"], v["mocap_quat"])
    vel = velocities(model, kin, v["qvel"])
    wrench = external_wrench(
        model, kin, v["xfrc_applied"], v["contact"], v["contact_force"], v["eq_force"]
    )
    found = {
        "cinert": body_forces.cinert(model, kin),
        "cvel": body_forces.cvel(model, kin, vel),
        "cacc": body_forces.cacc(model, kin, vel, v["qacc"]),
        "cfrc_ext": body_forces.cfrc_ext(model, kin, wrench),
    }
    motion = (found[name] for name in ("cvel", "cacc", "cfrc_ext"))
    inertia = body_forces.body_inertias(model, kin)
    found["cfrc_int"] = body_forces.cfrc_int(model, inertia, *motion)
    return found, project_wrench(model, kin, wrench, kin.xipos)


def test_external_wrenches_are_all_forces_of_constraints(scene):
    mj, instants = scene
    assert any(d.ncon > 0 for d, _ in instants)
    for d, values in instants:
        expected = d.qfrc_constraint.copy()
        for b in range(mj.nbody):
            force, torque = np.split(d.xfrc_applied[b], 2)
            mujoco.mj_applyFT(mj, d, force, torque, d.xipos[b], b, expected)
        _, actual = _quantities(build(mj), values)
        np.testing.assert_allclose(actual, expected, atol=1e-10 * np.linalg.norm(expected))


@pytest.mark.parametrize("name", ["cinert", "cvel", "cacc", "cfrc_ext", "cfrc_int"])
def test_agrees_with_mujoco(scene, name):
    mj, instants = scene
    for d, values in instants:
        expected = getattr(d, name)
        actual = _quantities(build(mj), values)[0][name]
        scale = 1 + np.linalg.norm(expected)
        np.testing.assert_allclose(actual, expected, atol=1e-11 * scale, rtol=0)


def test_without_contacts_and_equalities_only_the_applied_force_is_left(scene):
    mj, [(_, values), *_] = scene
    wrench = external_wrench(build(mj), None, jnp.asarray(values["xfrc_applied"]))
    np.testing.assert_array_equal(np.roll(wrench, 3, axis=1), values["xfrc_applied"])
