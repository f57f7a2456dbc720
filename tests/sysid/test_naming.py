"""Names of parameters mean the numbers they say, or are refused with a hint."""

import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.sysid import Parameter, SysidError
from jaxsim.sysid.naming import entries
from jaxsim.sysid.parameters import ParameterSet

SCENE = """
<mujoco><worldbody>
  <body name="box"><freejoint name="free"/><geom name="box" type="box" size=".1 .2 .3"/></body>
  <body name="left_arm" pos="1 0 0"><joint name="left" damping="2" armature=".1"/>
    <geom size=".1" pos="0 0 .1"/></body>
  <body name="right_arm" pos="2 0 0"><joint name="right" damping="3"/>
    <geom size=".1" pos="0 0 .1"/></body>
</worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def model():
    return jaxsim.load(SCENE)


@pytest.mark.parametrize(
    ("name", "labels", "index"),
    [
        ("body_mass[box]", ["body_mass[box]"], [[1]]),
        ("geom_friction[box, 1]", ["geom_friction[box, 1]"], [[0, 1]]),
        ("dof_damping[right]", ["dof_damping[right]"], [[7]]),
        ("dof_damping[free, 4]", ["dof_damping[free, 4]"], [[4]]),
        ("jnt_pos[left, 2]", ["jnt_pos[left, 2]"], [[1, 2]]),
        ("body_mass[*_arm]", ["body_mass[left_arm]", "body_mass[right_arm]"], [[2], [3]]),
        ("geom_size[1, 0]", ["geom_size[1, 0]"], [[1, 0]]),
        ("opt.gravity[2]", ["opt.gravity[2]"], [[2]]),
        ("opt.density", ["opt.density"], [[]]),
    ],
)
def test_what_a_name_means(model, name, labels, index):
    found = entries(model, name)
    assert list(found.labels) == labels
    np.testing.assert_array_equal(found.index, np.array(index, int).reshape(len(labels), -1))
    changed = found.write(model, found.read(model) + 1)
    np.testing.assert_array_equal(found.read(changed), found.read(model) + 1)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("body_mas[box]", "no numbers called 'body_mas'"),
        ("body_mass[bix]", "no body named 'bix'; its body names are world, box"),
        ("geom_friction[box, 3]", "none of the components 0 to 2"),
        ("body_mass[box, 0, 1]", "more components"),
        ("body_mass[box", "no name of a parameter"),
        ("jnt_type[left]", "no numbers called"),
        ("key_qpos[0]", "does not belong to elements"),
        ("dof_armature[right]", "starts at 0"),
        ("inertia[*]", "must name one body"),
        ("inertia[world]", "no mass"),
    ],
)
def test_wrong_names_are_told(model, name, message):
    with pytest.raises(SysidError, match=message) as error:
        ParameterSet(model, [name])
    assert isinstance(error.value, jaxsim.JaxsimError)


def test_one_number_twice_is_refused(model):
    with pytest.raises(SysidError, match="fitted twice"):
        ParameterSet(model, ["dof_damping[left]", Parameter("dof_damping[left]", start=1.0)])
    with pytest.raises(SysidError, match="no parameters"):
        ParameterSet(model, [])


def test_coordinates_are_logarithms_of_positive_numbers(model):
    wanted = ["dof_damping[left]", "geom_size[box, 2]", "jnt_pos[left, 0]", "mass[box]"]
    chosen = ParameterSet(model, [*wanted, Parameter("geom_friction[*, 0]", 0.5, tied=True)])
    x = chosen.stacked("start")
    expected = np.log([2, 0.3, 1, model.body_mass[1], 0.5])
    np.testing.assert_allclose(x, expected, rtol=1e-5)
    changed = quick_jit(chosen.model)(x + np.float32(np.log(2)))
    np.testing.assert_allclose(changed.dof_damping[6], 4, rtol=1e-5)
    np.testing.assert_allclose(changed.geom_friction[:, 0], 1, rtol=1e-5)
    np.testing.assert_allclose(changed.body_mass[1], 2 * model.body_mass[1], rtol=1e-5)
    np.testing.assert_allclose(changed.body_inertia[1], 2 * model.body_inertia[1], rtol=1e-5)
    # Constants follow: the inverse weight of the box is that of its new mass.
    np.testing.assert_allclose(changed.body_invweight0[1], model.body_invweight0[1] / 2, rtol=1e-4)
