"""A type of joint that `jaxsim` does not have, registered as `docs/extending.md` says."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from helical import HELICAL, PITCH
from oracle import quick_jit

from jaxsim.dynamics.aba import forward_dynamics
from jaxsim.dynamics.components import motion_components
from jaxsim.dynamics.crba import mass_matrix
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.rnea import inverse_dynamics
from jaxsim.dynamics.velocity import velocities
from jaxsim.forces.spring import qfrc_spring
from jaxsim.io import load
from jaxsim.joints import JOINTS
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.quantities.energy import kinetic_energy, potential_energy

SCREWS = """
<mujoco><default><geom contype="0" conaffinity="0"/></default><worldbody>
  <body><freejoint/><geom size=".2" mass="1"/>
    <body pos=".3 0 0"><joint type="ball" stiffness="3"/><geom type="box" size=".1 .2 .3"/>
      <body pos="0 .4 0"><joint axis="1 2 2" pos=".1 0 0" stiffness="20" springref="30"/>
        <geom type="box" size=".1 .3 .2" pos=".1 .1 0"/></body></body></body>
  <body pos="2 0 0"><joint axis="0 1 0"/><geom size=".1" pos=".1 0 .2"/></body>
</worldbody></mujoco>
"""
PARALLEL = """
<mujoco><worldbody><body><joint axis="0 1 0"/><geom size=".1" pos="0 0 1"/>
  <body pos="0 0 1"><joint axis="0 -1 0"/><geom size=".1" pos="0 0 1"/></body></body>
</worldbody></mujoco>
"""


@pytest.fixture(autouse=True)
def registered(monkeypatch):
    monkeypatch.setitem(JOINTS, HELICAL.number, HELICAL)


def test_dynamics_of_a_tree_with_screws_obey_the_laws():
    model, rng = load(SCREWS), np.random.default_rng(0)
    qpos = integrate_pos(model, model.qpos0, jnp.asarray(rng.normal(size=model.nv)), 1.0)
    qvel = jnp.asarray(rng.normal(size=model.nv))

    def energy(qpos, qvel):
        kin = kinematics(model, qpos)
        kinetic = kinetic_energy(model, kin, velocities(model, kin, qvel), qvel)
        return kinetic + potential_energy(model, kin, qpos), kinetic

    @quick_jit
    def compute(qpos, qvel):
        spring = qfrc_spring(model, kinematics(model, qpos), qpos)
        qacc = forward_dynamics(model, qpos, qvel, spring)
        moved = lambda t: energy(integrate_pos(model, qpos, qvel, t), qvel + t * qacc)[0]  # noqa: E731
        return {
            "kinetic": energy(qpos, qvel)[1],
            "form": 0.5 * qvel @ mass_matrix(model, qpos) @ qvel,
            "spring": spring,
            "needed": inverse_dynamics(model, qpos, qvel, qacc),
            "power": jax.jvp(moved, (0.0,), (1.0,))[1],
        }

    found = compute(qpos, qvel)
    np.testing.assert_allclose(found["kinetic"], found["form"], rtol=1e-12)
    np.testing.assert_allclose(found["needed"], found["spring"], atol=1e-9)
    np.testing.assert_allclose(found["power"], 0, atol=1e-9)


def test_screws_about_one_axis_leave_the_plane_along_it_only():
    model = load(PARALLEL)
    assert motion_components(model) == (1, 3, 4, 5)
    qpos = jnp.array([0.5, 0.0])
    pose = kinematics(model, qpos).xpos
    np.testing.assert_allclose(pose[1], [0, PITCH * 0.5, 0], atol=1e-15)
