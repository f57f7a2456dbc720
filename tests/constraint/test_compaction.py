"""Solves that leave out the contacts that push nowhere in a batch: few, none, all of them, many."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.arrays import tuning
from jaxsim.constraint import compaction
from jaxsim.lanes import switch

PLATES = 3  # of four balls each
PLATE = """<body pos="{x} 0 0"><joint type="free"/>
  <geom size=".1" pos=".2 .2 0" {more}/><geom size=".1" pos="-.2 .2 0" {more}/>
  <geom size=".1" pos=".2 -.2 0" {more}/><geom size=".1" pos="-.2 -.2 0" {more}/></body>"""
MODEL = """<mujoco><option cone="{cone}"/><worldbody>
  <geom type="plane" size="9 9 1" condim="{condim}"/>
  {plates}</worldbody></mujoco>"""

# Both solves converge to the same point; what remains is the rounding of different sums.
RTOL, ATOL = 1e-9, 1e-8


def load(cone="pyramidal", condim=3):
    more = f'condim="{condim}" contype="0"'
    plates = "".join(PLATE.format(x=x, more=more) for x in range(PLATES))
    return jaxsim.load(MODEL.format(cone=cone, condim=condim, plates=plates))


def states(model, standing):
    """Environments in which so many plates are on the floor, tilted a little; the others fall."""
    rng = np.random.default_rng(3)
    state = jaxsim.make_state(model)
    qpos = np.tile(np.asarray(state.qpos), (len(standing), 1)).reshape(-1, PLATES, 7)
    down = np.arange(PLATES) < np.array(standing)[:, None]
    qpos[..., 2] = np.where(down, 0.095, 2.0)
    qpos[..., 4] = 0.01
    qvel = rng.normal(scale=0.1, size=(len(standing), PLATES, 6))
    qvel[..., 2] = -0.1
    qvel = qvel.reshape(len(standing), model.nv)
    batch = jax.tree.map(lambda x: jnp.broadcast_to(x, (len(standing), *x.shape)), state)
    return batch.replace(qpos=jnp.asarray(qpos.reshape(-1, 7 * PLATES)), qvel=jnp.asarray(qvel))


def compiled(model):
    """Accelerations and what is left of the gradient, of a batch of three."""

    def found(state):
        result = jaxsim.forward(model, state, jnp.zeros(0))
        return result.qacc, result.status.residual

    return quick_jit(jaxsim.vmap(found)).lower(states(model, [0, 0, 0])).compile()


@functools.cache
def both_ways(cone, condim):
    """The model, and its program with and without a shorter one in it."""
    model = load(cone, condim)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuning, "COMPACTION_FACTOR", 1000)
        whole = compiled(model)
    return model, compiled(model), whole


@pytest.mark.parametrize(
    ("cone", "condim"), [("pyramidal", 3), pytest.param("elliptic", 4, marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("standing", [[0, 0, 0], [1, 0, 1], [2, 1, 0], [3, 0, 1], [3, 3, 3]])
def test_accelerations_do_not_depend_on_how_many_contacts_push(cone, condim, standing):
    model, shortening, whole = both_ways(cone, condim)
    batch = states(model, standing)
    got, residual = shortening(batch)
    np.testing.assert_allclose(got, whole(batch)[0], RTOL, ATOL)
    np.testing.assert_allclose(residual, 0, atol=1e-5)
    vertical = np.asarray(got).reshape(3, PLATES, 6)[..., 2]
    falls = np.arange(PLATES) >= np.array(standing)[:, None]
    np.testing.assert_allclose(vertical[falls], -9.81, RTOL)
    assert (vertical[~falls] > 0).all()  # pushed out of the floor


@pytest.mark.parametrize(("standing", "shorter"), [([2, 1, 2], True), ([2, 3, 0], False)])
def test_the_shorter_program_runs_where_few_contacts_push(monkeypatch, standing, shorter):
    """Eight in the first batch, twelve in the second; the shorter program is made a wrong one."""
    model = load()
    batch = states(model, standing)
    kept = compaction._kept
    nothing = lambda *args: jax.tree.map(jnp.zeros_like, kept(*args))  # noqa: E731
    monkeypatch.setattr(compaction, "_kept", nothing)
    vertical = np.asarray(compiled(model)(batch)[0]).reshape(3, PLATES, 6)[..., 2]
    assert (vertical[0, 0] < -9) == shorter


@pytest.mark.parametrize(("standing", "slots"), [(1, 4), (2, 8), (3, 12)])
def test_kernels_take_the_smallest_solve_that_is_enough(monkeypatch, standing, slots):
    """Solves with other numbers of slots are made wrong ones."""
    pytest.importorskip("llvmlite")
    monkeypatch.setattr(switch, "_enabled", True)
    model = load()
    batch = states(model, [standing, 1, 0])
    kept = compaction._kept

    def wrong_for_others(kind, index, exists):
        found = kept(kind, index, exists)
        return found if len(index) == slots else jax.tree.map(jnp.zeros_like, found)

    monkeypatch.setattr(compaction, "_kept", wrong_for_others)
    step = lambda state: jaxsim.step(model, state, jnp.zeros(0)).qvel  # noqa: E731
    found = quick_jit(jaxsim.vmap(step))(batch)
    monkeypatch.setattr(switch, "_enabled", False)
    monkeypatch.setattr(tuning, "COMPACTION_FACTOR", 1000)
    expected = quick_jit(jaxsim.vmap(step))(batch)
    np.testing.assert_allclose(found, expected, RTOL, 1e-5)


def test_without_lanes_nothing_is_compiled_twice():
    model = load()
    forward = lambda state: jaxsim.forward(model, state, jnp.zeros(0)).qacc  # noqa: E731
    batch = states(model, [1, 1, 1])
    one = jax.tree.map(lambda x: x[0], batch)
    for f, start in ((forward, one), (jax.vmap(forward), batch)):
        program = quick_jit(f).lower(start).compile().as_text()
        assert " while(" in program
        assert " conditional(" not in program


def test_derivatives_are_those_of_the_whole_problem():
    model, state = load(), states(load(), [2, 1, 0])

    def qacc(qvel, state):
        return jaxsim.forward(model, state.replace(qvel=qvel), jnp.zeros(0)).qacc

    def derivative():
        pull = lambda v, s: jax.vjp(lambda v: qacc(v, s), v)[1](jnp.ones_like(v))  # noqa: E731
        return quick_jit(jaxsim.vmap(pull))(state.qvel, state)

    got = derivative()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(tuning, "COMPACTION_FACTOR", 1000)
        expected = derivative()
    np.testing.assert_allclose(got, expected, RTOL, 1e-6)
