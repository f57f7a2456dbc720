"""Facts: computed once, and never for numbers that are not the model's."""

import copy
import pickle

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.collision import candidates as candidates_module
from jaxsim.collision import model_candidates
from jaxsim.model.facts import Constants, fact

PAIR = """<mujoco><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 1"><freejoint/><geom size=".1"/></body>
  <body pos="1 0 1"><joint/><geom size=".2" pos=".1 0 0"/></body></worldbody></mujoco>"""


@pytest.fixture
def counted():
    """A fact that depends on sizes, and the arguments that it was computed of."""
    calls = []

    @fact("geom_size", "geom_pos", unknown=-1.0)
    def volume(model, size, pos):
        calls.append((model, size, pos))
        return float(size[:, 0].sum()) * model.ngeom

    return volume, calls


@pytest.fixture
def model():
    return jaxsim.load(PAIR)


def test_computed_once_for_the_same_numbers(model, counted):
    volume, calls = counted
    first = volume(model)
    assert first == pytest.approx(0.3 * 3 + 3, rel=1e-6)
    again = model.replace(geom_size=jnp.array(model.geom_size), body_mass=2 * model.body_mass)
    seen = []
    jax.jit(lambda x: seen.append(volume(again)) or x)(0.0)
    assert (volume(again), seen, len(calls)) == (first, [first], 1)
    assert all(type(x) is np.ndarray for x in calls[0][1:])


def test_computed_again_for_other_numbers_or_flags(model, counted):
    volume, calls = counted
    larger = model.replace(geom_size=2 * model.geom_size)
    assert volume(larger) == pytest.approx(2 * volume(model))
    assert volume(larger) == pytest.approx(2 * volume(model))
    before = len(calls)
    volume(model.replace(opt=model.opt.replace(disableflags=1)))
    assert len(calls) == before + 1


def test_not_known_of_what_is_traced(model, counted):
    volume, calls = counted
    seen = []

    def look(size):
        seen.append(volume(model.replace(geom_size=size)))
        return size.sum()

    jax.jit(look)(model.geom_size), jax.grad(look)(model.geom_size)
    jax.vmap(look)(model.geom_size[None]), jaxsim.vmap(look)(model.geom_size[None])
    assert (seen, calls) == ([-1.0] * 4, [])


def test_a_model_of_mujoco_is_looked_at_every_time(counted):
    volume, calls = counted
    mj = mujoco.MjModel.from_xml_string(PAIR)
    before = volume(mj)
    mj.geom_size[1] = 1.0
    assert volume(mj) == pytest.approx(before + 2.7)
    assert len(calls) == 2


def test_models_with_facts_are_copied_and_pickled(model):
    groups = model_candidates(model).groups
    for other in (copy.deepcopy(model), pickle.loads(pickle.dumps(model))):
        assert other.structure == model.structure
        assert [len(g) for g in model_candidates(other).groups] == [len(g) for g in groups]


def test_constants_are_the_numbers_and_tell_programs_apart(model):
    names = ("geom_size", "body_quat")
    constants = Constants.of(model, names)
    assert constants == Constants.of(model.replace(body_mass=2 * model.body_mass), names)
    other = model.replace(geom_size=2 * model.geom_size)
    assert constants != Constants.of(other, names)
    back = constants.put_into(other)
    np.testing.assert_array_equal(back.geom_size, model.geom_size)
    assert back.geom_size.dtype == model.geom_size.dtype


def test_there_are_no_constants_of_what_is_traced(model):
    seen = []
    jax.jit(lambda m: seen.append(Constants.of(m, ("geom_size",))) or m.geom_size)(model)
    assert seen == [Constants()]
    assert Constants().put_into(model).geom_size is model.geom_size


def test_tracing_a_step_does_not_search_for_pairs_again(model, monkeypatch):
    searches = []
    search = candidates_module.candidate_pairs
    monkeypatch.setattr(
        candidates_module, "candidate_pairs", lambda m: searches.append(m) or search(m)
    )
    state = jaxsim.make_state(model)
    trace = lambda *args: jax.eval_shape(lambda m, s: jaxsim.step(m, s), *args)  # noqa: E731
    trace(model, state)
    trace(model.replace(jnt_axis=-model.jnt_axis), state)
    jax.eval_shape(lambda s: jaxsim.step(model, s), state)
    assert searches == []
    jaxsim.load(PAIR)
    assert len(searches) == 1
