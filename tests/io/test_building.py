"""The built model: MuJoCo's fields under MuJoCo's names, numbers as leaves, the rest static."""

import copy
import dataclasses
import pickle

import jax
import mujoco
import numpy as np
import pytest
from random_models import random_model

import jaxsim
from jaxsim.io import load
from jaxsim.model import Model
from jaxsim.model.structure import ARRAYS, SIZES


@pytest.fixture(scope="module")
def pair():
    """A model with most kinds of elements, MuJoCo's and ours."""
    xml = random_model(0, bodies=4, equality=True, limits=True, mocap=True, frictionloss=True)
    mj = mujoco.MjModel.from_xml_string(xml)
    with jax.enable_x64(True):
        return mj, load(mj)


def test_every_leaf_has_the_value_of_mujoco(pair):
    mj, model = pair
    groups = {"structure", "opt", "stat"}
    # MuJoCo's law and MuJoCo's models have none.
    of_plugins = {"body_cable", "actuator_pid", "sdf"}
    ours = of_plugins | {"geom_stiffness", "geom_relaxation", "geom_restitution"}
    for field in dataclasses.fields(Model):
        if field.name not in groups | ours and field.metadata.get("pytree_node", True):
            found, expected = getattr(model, field.name), getattr(mj, field.name)
            if found is None:  # delays, in models that have some
                assert not expected.any(), field.name
                continue
            np.testing.assert_allclose(found, expected, atol=1e-8, err_msg=field.name)


def test_every_static_field_has_the_value_of_mujoco(pair):
    mj, model = pair
    for name in (*SIZES, *ARRAYS):
        np.testing.assert_array_equal(getattr(model, name), getattr(mj, name), err_msg=name)


def test_options_have_the_values_of_mujoco(pair):
    mj, model = pair
    for field in dataclasses.fields(model.opt):
        np.testing.assert_array_equal(getattr(model.opt, field.name), getattr(mj.opt, field.name))
    assert model.opt.disabled(mujoco.mjtDisableBit.mjDSBL_GRAVITY) is False
    assert model.opt.enabled(mujoco.mjtEnableBit.mjENBL_ENERGY) is False


def test_static_arrays_are_read_only(pair):
    with pytest.raises(ValueError, match="read-only"):
        pair[1].jnt_type[0] = 3


def test_leaves_are_copies(pair):
    mj, model = pair
    before = np.array(model.body_mass)
    mj.body_mass[1] += 1
    np.testing.assert_array_equal(model.body_mass, before)
    mj.body_mass[1] -= 1


def test_unknown_attribute_is_an_attribute_error(pair):
    with pytest.raises(AttributeError, match="no attribute 'body_weight'"):
        pair[1].body_weight
    assert not hasattr(pair[1], "body_weight")


def test_model_can_be_copied_pickled_and_flattened(pair, x64):
    _, model = pair
    leaves, tree = jax.tree.flatten(model)
    for twin in (
        copy.copy(model),
        copy.deepcopy(model),
        pickle.loads(pickle.dumps(model)),
        jax.tree.unflatten(tree, leaves),
    ):
        assert twin.structure == model.structure
        assert twin.nq == model.nq
        np.testing.assert_array_equal(twin.body_mass, model.body_mass)


def test_every_leaf_is_an_array_of_the_default_float_type(pair):
    assert {x.dtype for x in jax.tree.leaves(pair[1])} == {np.dtype("float64")}
    single = jax.tree.leaves(load(pair[0]))
    assert {x.dtype for x in single} == {np.dtype("float32")}


def test_frames_are_those_that_the_engine_uses():
    """MuJoCo does not look at a pose that it marked as aligned with the body's."""
    mj = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><freejoint/><geom size=".1"/>
        <geom size=".1" pos="1 0 0"/><site name="s"/></body></worldbody></mujoco>"""
    )
    for field in (mj.geom_pos, mj.site_pos):
        field[0] = 1e-9
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    with jax.enable_x64(True):
        model = load(mj)
    np.testing.assert_array_equal(model.geom_pos, data.geom_xpos)
    np.testing.assert_array_equal(model.site_pos, data.site_xpos)


def test_armature_of_an_actuator_on_a_joint_or_a_tendon():
    xml = """<mujoco><worldbody><body><joint name="j"/><geom size="1"/></body></worldbody>
      <tendon><fixed name="t"><joint joint="j" coef="1"/></fixed></tendon>
      <actuator><motor {}="{}" armature="1"/></actuator></mujoco>"""
    for kind, name in (("joint", "j"), ("tendon", "t")):
        mj = mujoco.MjModel.from_xml_string(xml.format(kind, name))
        data = mujoco.MjData(mj)
        mujoco.mj_forward(mj, data)
        with jax.enable_x64(True):
            model = load(mj)
            mass = jaxsim.mass_matrix(model, jaxsim.make_state(model).qpos)
        full = np.zeros((1, 1))
        mujoco.mj_fullM(mj, data, full)
        np.testing.assert_allclose(mass, full, rtol=1e-12)
