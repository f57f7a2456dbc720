"""Trees in which the joints of a body make one."""

import jax
import mujoco
import numpy as np
import pytest
from oracle import quick_jit
from random_models import random_model

from jaxsim.dynamics.aba import articulated_solve
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.io import load
from jaxsim.model.dof_order import from_compound_order, to_compound_order

SEVERAL = """
<mujoco>
  <default><joint armature=".1"/></default>
  <worldbody>
    <body><geom size=".1"/>
      <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
      <joint type="slide" axis="0 0 1"/><joint type="ball"/>
      <body pos="1 0 0"><geom size=".1"/><joint axis="0 0 1"/><joint axis="0 1 0"/></body>
      <body pos="0 1 0"><geom size=".1"/></body>
    </body>
    <body><freejoint/><geom size=".1"/></body>
  </worldbody>
</mujoco>
"""


def test_the_joints_of_a_body_are_one():
    model = load(SEVERAL)
    compound = model.structure.compound
    assert sorted(compound.tree.ndof) == [2, 6, 6]
    assert sorted(compound.dof) == list(range(model.nv))
    # What a body moves with is the last of its joints, which keeps its place among the bodies.
    for body in range(1, model.nbody):
        link = model.body_link[body]
        assert compound.link[compound.node[link]] == link
    assert compound.node[-1] == -1


def test_a_tree_without_such_bodies_stays_as_it_is():
    model = load("quadruped")
    assert model.structure.compound.tree is model.tree
    np.testing.assert_array_equal(model.structure.compound.dof, np.arange(model.nv))


@pytest.mark.parametrize("source", [SEVERAL, *range(4)])
def test_a_compound_tree_has_the_same_mass_matrix(source, x64):
    mj = mujoco.MjModel.from_xml_string(source if source == SEVERAL else random_model(source))
    model, data = load(mj), mujoco.MjData(mj)
    rng = np.random.default_rng(0)
    mujoco.mj_integratePos(mj, data.qpos, rng.standard_normal(mj.nv), 1.0)
    mujoco.mj_forward(mj, data)
    compound, force = model.structure.compound, rng.standard_normal(mj.nv)

    @quick_jit
    def acceleration(qpos, force):
        kin = kinematics(model, qpos)
        matrices = jax.vmap(lambda inertia: inertia.as_matrix())(kin.inertia)
        found, _ = articulated_solve(
            compound.tree,
            kin.cdof[compound.dof],
            matrices[compound.link],
            to_compound_order(model, dof_armature(model)),
            to_compound_order(model, force),
        )
        return from_compound_order(model, found)

    momentum = np.zeros(mj.nv)
    mujoco.mj_mulM(mj, data, momentum, np.array(acceleration(data.qpos, force)))
    np.testing.assert_allclose(momentum, force, atol=1e-8)
