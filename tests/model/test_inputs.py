"""Arguments of the engine: each mistake is an error, while tracing, that says what was expected."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.model import Model
from jaxsim.model.inputs import admit, admit_array, admit_model

XML = """<mujoco><option integrator="{}"/><worldbody>
  <body mocap="true"/>
  <body><joint name="j" damping="1" frictionloss=".1"/><geom size=".1" pos="0 0 -.3"/></body>
  </worldbody>
  <actuator><general joint="j" dyntype="filter" dynprm=".1" gainprm="2"/>
    <motor joint="j"/></actuator>
  <keyframe><key qpos="1"/></keyframe></mujoco>"""


@pytest.fixture(scope="module")
def model():
    return jaxsim.load(XML.format("Euler"))


@pytest.fixture(scope="module")
def state(model):
    return jaxsim.make_state(model)


def _leaves(record) -> list[str]:
    return [k for k, value in vars(record).items() if isinstance(value, jax.Array)]


def test_what_is_right_comes_back_itself(model, state):
    ctrl = jnp.zeros(2)
    again = admit(model, state, ctrl)
    assert all(a is b for a, b in zip(again, (model, state, ctrl), strict=True))


def test_a_check_is_no_part_of_the_program(model, state):
    program = jax.make_jaxpr(lambda m, s: admit(m, s))(model, state)
    assert not program.eqns


@pytest.mark.parametrize("function", [jaxsim.step, jaxsim.forward, jaxsim.step_with_status])
def test_every_field_of_the_state_is_checked(model, state, function):
    for name in _leaves(state):
        longer = state.replace(**{name: jnp.zeros((*state.qpos.shape, 7))})
        if name == "time_excess":  # a state gives itself one of the right shape
            assert longer.time_excess.shape == ()
            continue
        with pytest.raises(ValueError, match=rf"^state\.{name} must have shape \(.*jax.vmap"):
            jax.eval_shape(function, model, longer)
        whole = jnp.zeros(getattr(state, name).shape, int)
        with pytest.raises(TypeError, match=rf"^state\.{name} must be of type float32.*int32"):
            jax.eval_shape(function, model, state.replace(**{name: whole}))


def test_every_field_of_the_model_is_checked(model):
    for name in _leaves(model):
        with pytest.raises(ValueError, match=rf"^model\.{name} must have shape"):
            admit_model(model.replace(**{name: jnp.zeros((1, 2, 3, 4))}))
        whole = jnp.zeros(getattr(model, name).shape, int)
        with pytest.raises(TypeError, match=rf"^model\.{name} must be of "):
            admit_model(dataclasses.replace(model, **{name: whole}))


def test_every_option_is_checked(model):
    for name in _leaves(model.opt):
        wrong = model.replace(opt=model.opt.replace(**{name: jnp.zeros((2, 2))}))
        with pytest.raises(ValueError, match=rf"^model\.opt\.{name} must have shape"):
            admit_model(wrong)


def test_a_batch_without_vmap_is_an_error(model, state):
    heavy = model.replace(body_mass=jnp.stack([model.body_mass] * 2))
    with pytest.raises(
        ValueError, match=r"body_mass must have shape \(3,\), got \(2, 3\); batches"
    ):
        jax.eval_shape(jaxsim.step, heavy, state)
    axes = jax.tree.map(lambda _: None, model).replace(body_mass=0, present=heavy.present)
    many = jax.eval_shape(jax.vmap(jaxsim.step, (axes, None)), heavy, state)
    assert many.qpos.shape == (2, 1)


@pytest.mark.parametrize("step", [jaxsim.step, jaxsim.forward, jaxsim.rollout])
def test_swapped_arguments(model, state, step):
    with pytest.raises(TypeError, match="the model comes first, then the state"):
        step(state, model, jnp.zeros((3, 2)))


def test_other_things(model, state):
    with pytest.raises(TypeError, match=r"expected a jaxsim\.Model, got str; see jaxsim\.load"):
        jaxsim.step("pendulum", state)
    with pytest.raises(TypeError, match=r"expected a jaxsim\.State, got ArrayImpl; see jaxsim"):
        jaxsim.step(model, state.qpos)
    with pytest.raises(TypeError, match=r"expected a jaxsim\.Model, got str; see jaxsim\.load"):
        jaxsim.make_state("pendulum")
    with pytest.raises(TypeError, match=r"expected a jaxsim\.State, got Model; see jaxsim"):
        jaxsim.to_mujoco(model, model)
    with pytest.raises(TypeError, match=r"expected a jaxsim\.Model, got State; see jaxsim\.load"):
        jaxsim.batch_rollout(state, model, jnp.zeros((1, 2, 2)))


@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        ([0.0, 0.0], TypeError, "ctrl must be an array, got list"),
        (0.0, TypeError, "ctrl must be an array, got float"),
        (np.zeros(2, int), TypeError, "ctrl must be of type float32, got int"),
        (np.zeros(2, bool), TypeError, "ctrl must be of type float32, got bool"),
        (np.zeros((1, 2)), ValueError, r"ctrl must have shape \(2,\), got \(1, 2\); batches go"),
        (np.zeros((2, 1)), ValueError, r"ctrl must have shape \(2,\), got \(2, 1\); batches go"),
        (np.zeros(1), ValueError, r"ctrl must have shape \(2,\), got \(1,\)"),
    ],
)
def test_controls(model, state, value, error, message):
    with pytest.raises(error, match=message):
        jaxsim.step(model, state, value)


def test_any_length_is_said_to_be_any(model):
    with pytest.raises(ValueError, match=r"ctrls must have shape \(any, 2\), got \(2,\)"):
        admit_array(model, jnp.zeros(2), (None, 2), "ctrls")


@pytest.mark.parametrize("function", [jaxsim.forward_dynamics, jaxsim.inverse_dynamics])
def test_dynamics_alone(model, function):
    one = jnp.zeros(1)
    with pytest.raises(TypeError, match="qpos must be an array, got list"):
        function(model, [0.0], one, one)
    with pytest.raises(ValueError, match=r"qvel must have shape \(1,\), got \(2,\)"):
        function(model, one, jnp.zeros(2), one)
    with pytest.raises(ValueError, match=r"qpos must have shape \(1,\), got \(3,\)"):
        jaxsim.mass_matrix(model, jnp.zeros(3))


@pytest.mark.parametrize("timestep", [0.0, -1.0, np.nan, jnp.array(0.0)])
def test_a_timestep_that_is_not_positive(model, state, timestep):
    frozen = model.replace(opt=model.opt.replace(timestep=timestep))
    with pytest.raises(ValueError, match=r"opt\.timestep must be positive, got"):
        jax.eval_shape(lambda state: jaxsim.step(frozen, state), state)


@pytest.mark.parametrize("name", "Euler RK4 implicit implicitfast".split())
def test_a_number_as_a_timestep(name, state):
    model = jaxsim.load(XML.format(name))
    with_number = model.replace(opt=model.opt.replace(timestep=0.01))
    with_array = model.replace(opt=model.opt.replace(timestep=jnp.array(0.01)))
    ctrl = jnp.ones(2)
    steps = quick_jit(lambda s: [jaxsim.step(m, s, ctrl) for m in (with_number, with_array)])
    got, expected = steps(state)
    jax.tree.map(np.testing.assert_array_equal, got, expected)
    shapes = jax.eval_shape(lambda s: jaxsim.rollout(with_number, s, jnp.zeros((3, 2))), state)
    assert shapes[0].time.dtype == model.qpos0.dtype


def test_float64_controls_leave_a_float32_model_as_it_is(model, state):
    with jax.enable_x64(True):
        ctrl = jnp.zeros(2)
        assert ctrl.dtype == "float64"
        after = jax.eval_shape(jaxsim.step, model, state, ctrl)
        final, _ = jax.eval_shape(jaxsim.rollout, model, state, jnp.zeros((3, 2)))
    assert {x.dtype for x in jax.tree.leaves((after, final))} == {np.dtype("float32")}


def test_states_of_another_precision(model, state):
    with jax.enable_x64(True):
        double = jax.tree.map(lambda x: x.astype("float64"), state)
        with pytest.raises(TypeError, match="state.qpos must be of type float32, .* got float64"):
            jax.eval_shape(jaxsim.step, model, double)


def test_precision_that_was_switched_off_after_loading():
    with jax.enable_x64(True):
        model = jaxsim.load(XML.format("Euler"))
        state = jaxsim.make_state(model)
    with pytest.raises(TypeError, match="float64, which JAX has switched off since it was loaded"):
        jaxsim.step(model, state)


def test_numpy_arrays_are_arrays(model, state):
    numbers = jax.tree.map(np.asarray, state), jax.tree.map(np.asarray, model)
    _, admitted, _ = admit(model, numbers[0])
    jax.tree.map(np.testing.assert_array_equal, admitted, state)
    assert isinstance(admit_model(numbers[1]).body_mass, jax.Array)
    assert isinstance(admit_model(numbers[1]), Model)
