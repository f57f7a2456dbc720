"""The initial state, and keyframes by index and by name."""

import jax
import numpy as np
import pytest

from jaxsim.io import load
from jaxsim.model import make_state

XML = """<mujoco>
  <worldbody>
    <body name="link" pos="0 0 1"><joint name="hinge" ref="0.5"/><geom size=".1"/></body>
    <body name="hand" mocap="true" pos="1 2 3" quat="0 1 0 0"><geom size=".1"/></body>
    <body name="free"><freejoint/><geom size=".1"/></body>
  </worldbody>
  <actuator><general joint="hinge" dyntype="filter" dynprm="1"/></actuator>
  <keyframe>
    <key name="home" qpos="1 0 0 5 1 0 0 0" qvel="7 0 0 0 0 0 0" act="0.3" time="2"
         mpos="4 5 6" mquat="0 0 1 0"/>
    <key qpos="2 0 0 5 1 0 0 0"/>
  </keyframe>
</mujoco>"""


@pytest.fixture(scope="module")
def model():
    return load(XML)


def test_default_state_is_the_reference_at_rest(model):
    state = make_state(model)
    np.testing.assert_array_equal(state.qpos, model.qpos0)
    np.testing.assert_array_equal(state.mocap_pos, [[1, 2, 3]])
    np.testing.assert_array_equal(state.mocap_quat, [[0, 1, 0, 0]])
    rest = (state.qvel, state.act, state.time, state.qfrc_applied, state.xfrc_applied)
    assert not any(np.any(x) for x in rest)


@pytest.mark.parametrize("key", [0, np.int64(0), "home"])
def test_keyframe_by_index_and_by_name(model, key):
    state = make_state(model, key)
    np.testing.assert_array_equal(state.qpos, [1, 0, 0, 5, 1, 0, 0, 0])
    np.testing.assert_array_equal(state.qvel, [7, 0, 0, 0, 0, 0, 0])
    np.testing.assert_allclose((state.act[0], state.time), (0.3, 2), rtol=1e-6)
    np.testing.assert_array_equal(state.mocap_pos, [[4, 5, 6]])
    np.testing.assert_array_equal(state.mocap_quat, [[0, 0, 1, 0]])


def test_unnamed_keyframe_by_index(model):
    assert make_state(model, 1).qpos[0] == 2


@pytest.mark.parametrize(
    ("key", "error", "message"),
    [
        ("hom", KeyError, "no key named 'hom'; did you mean 'home'"),
        (2, IndexError, "has 2 keyframes, got keyframe 2"),
        (-1, IndexError, "has 2 keyframes, got keyframe -1"),
        (0.5, TypeError, "an index or a name, got float"),
        (True, TypeError, "an index or a name, got bool"),
    ],
)
def test_unknown_keyframe(model, key, error, message):
    with pytest.raises(error, match=message):
        make_state(model, key)


def test_shapes_do_not_depend_on_the_keyframe(model):
    shapes = [jax.tree.map(np.shape, make_state(model, key)) for key in (None, 0, 1)]
    assert shapes[0] == shapes[1] == shapes[2]


@pytest.mark.parametrize("x64", [False, True])
def test_state_has_the_default_float_type(x64):
    with jax.enable_x64(x64):
        leaves = jax.tree.leaves(make_state(load(XML)))
    assert {leaf.dtype for leaf in leaves} == {np.dtype("float64" if x64 else "float32")}


def test_a_state_may_be_made_without_the_excess_of_its_time(model):
    state = make_state(model)
    parts = {name: getattr(state, name) for name in vars(state) if name != "time_excess"}
    assert jax.tree.structure(type(state)(**parts)) == jax.tree.structure(state)
    assert state.replace(time=np.arange(3.0)).time_excess.shape == (3,)
    nothing = jax.tree.map(lambda _: None, state)
    assert nothing.time_excess is None
