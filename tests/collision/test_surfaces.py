"""Contact parameters that are known to be shared, while their numbers stay arguments."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.collision import detect, find_candidates
from jaxsim.collision.surfaces import SURFACE, known_surfaces
from jaxsim.parallel.rollout import _compiled

BALL = '<body pos="{0} 0 .0{1}"><freejoint/><geom size=".1" {2}/></body>'
KINDS = ("", 'friction=".2"', "", 'margin=".01"', 'friction=".2"')


def scene(kinds=KINDS):
    balls = "".join(BALL.format(0.15 * i, i + 1, kind) for i, kind in enumerate(kinds))
    return f"""<mujoco><worldbody><geom type="plane" size="2 2 1" solref=".01 1"/>{balls}
      </worldbody></mujoco>"""


def test_the_first_of_a_kind_stands_for_it():
    expected = (0, 1, 2, 1, 4, 2)
    assert known_surfaces(jaxsim.load(scene())) == expected
    assert known_surfaces(mujoco.MjModel.from_xml_string(scene())) == expected
    assert known_surfaces(jaxsim.load("<mujoco/>")) == ()


@pytest.mark.parametrize("name", SURFACE)
def test_every_parameter_sets_geoms_apart(name):
    model = mujoco.MjModel.from_xml_string(scene([""] * 3))
    assert known_surfaces(model) == (0, 1, 1, 1)
    getattr(model, name)[2] = 3
    assert known_surfaces(model) == (0, 1, 2, 1)


def test_nothing_is_known_of_what_is_traced():
    model = jaxsim.load(scene())
    seen = []

    def look(friction):
        seen.append(known_surfaces(model.replace(geom_friction=friction)))
        return friction.sum()

    friction = model.geom_friction
    jax.jit(look)(friction), jax.grad(look)(friction), jaxsim.vmap(look)(friction[None])
    assert seen == [None] * 3
    jax.jit(lambda x: seen.append(known_surfaces(model)) or x)(0.0)
    assert seen[-1] is not None


@pytest.mark.parametrize("limits", [{}, {"max_contacts": 3}, {"max_geom_pairs": 4}], ids=str)
def test_parameters_are_those_of_each_geom(limits):
    """Known or traced, in slots of their own or assigned ones."""
    model = mujoco.MjModel.from_xml_string(scene())
    candidates = find_candidates(model, **limits)
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    poses = jnp.asarray(data.geom_xpos), jnp.asarray(data.geom_xmat).reshape(-1, 3, 3)
    known = detect(model, candidates, *poses)
    pair = np.stack([known.geom1, known.geom2])
    np.testing.assert_allclose(known.includemargin, model.geom_margin[pair].sum(0))
    np.testing.assert_allclose(known.friction[:, 0], model.geom_friction[pair, 0].max(0))
    np.testing.assert_allclose(known.solref, model.geom_solref[pair].mean(0))
    traced = jax.jit(lambda m: detect(m, candidates, *poses))(jaxsim.load(model))
    for name in ("geom1", "geom2", "includemargin", "friction", "solref", "solimp"):
        np.testing.assert_allclose(getattr(traced, name), getattr(known, name), rtol=1e-6)


def sliding(model):
    """The balls move along x."""
    state = jaxsim.make_state(model)
    return state.replace(qvel=state.qvel.at[::6].set(1.0))


def test_batch_rollout_takes_the_numbers_that_it_is_given():
    """Which geoms are alike is part of its program, what they are like is not."""
    model = jaxsim.load(scene(), max_contacts=6)
    assert find_candidates(model, model.max_geom_pairs, model.max_contacts).dynamic
    ctrls = jnp.zeros((20, 0))

    def at_once(model):
        state = jax.tree.map(lambda x: x[None], sliding(model))
        return jaxsim.batch_rollout(model, state, ctrls[None]).qvel[0]

    # Of a model that is an argument nothing is known.
    alone = quick_jit(lambda model: jaxsim.rollout(model, sliding(model), ctrls)[0].qvel)
    first, programs = at_once(model), _compiled.cache_info().misses
    smoother = model.replace(geom_friction=0.3 * model.geom_friction)
    expected = alone(smoother)
    np.testing.assert_allclose(at_once(smoother), expected, atol=1e-4)
    assert np.abs(expected - first).max() > 0.01
    assert _compiled.cache_info().misses == programs

    uneven = model.replace(geom_friction=model.geom_friction.at[3].set(0.0))
    expected = alone(uneven)
    np.testing.assert_allclose(at_once(uneven), expected, atol=1e-4)
    assert np.abs(expected - first).max() > 0.01


def test_derivatives_by_one_of_many_equal_geoms():
    """They are alike, but only one of them is changed."""
    model = mujoco.MjModel.from_xml_string(scene([""] * 4))
    candidates = find_candidates(model, max_contacts=3)
    data = mujoco.MjData(model)
    mujoco.mj_fwdPosition(model, data)
    poses = jnp.asarray(data.geom_xpos), jnp.asarray(data.geom_xmat).reshape(-1, 3, 3)
    ours = jaxsim.load(model)

    def solref(values):
        return detect(ours.replace(geom_solref=values), candidates, *poses).solref[:, 0].sum()

    gradient = jax.grad(solref)(ours.geom_solref)
    ids = detect(model, candidates, *poses)
    weight = np.bincount(np.concatenate([ids.geom1, ids.geom2]), minlength=model.ngeom) / 2
    np.testing.assert_allclose(gradient[:, 0], weight, rtol=1e-6)
    assert len(set(weight.tolist())) > 1
