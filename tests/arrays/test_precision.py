"""Every product of matrices in the physics is asked for in full precision."""

import jax
import jax.numpy as jnp
import pytest
from jax import lax
from leg import LEG

import jaxsim
from jaxsim.arrays.precision import full_precision
from jaxsim.batching.jaxprs import bodies
from jaxsim.envs import make
from jaxsim.io.constants import set_const


def _products(jaxpr):
    """The precision of each product in a program and in all that it calls."""
    for eqn in jaxpr.eqns:
        if eqn.primitive.name in ("dot_general", "lane_contract"):
            yield eqn.params["precision"]
        for body in bodies(eqn):
            yield from _products(body)


def _assert_full(f, *args):
    found = list(_products(jax.make_jaxpr(f)(*args).jaxpr))
    assert found
    highest = lax.Precision.HIGHEST
    assert {*found} <= {highest, (highest, highest)}


@pytest.fixture(scope="module", params=["articulated", "dense", "iterative"])
def scene(request):
    """A robot, whose products differ with the solve."""
    model = jaxsim.load(LEG, hessian=request.param)
    return model, jaxsim.make_state(model), jnp.zeros(model.nu)


def test_dynamics(scene):
    model, state, _ = scene
    qpos, v = state.qpos, state.qvel
    _assert_full(jaxsim.mass_matrix, model, qpos)
    _assert_full(jaxsim.inverse_dynamics, model, qpos, v, v)
    _assert_full(jaxsim.forward_dynamics, model, qpos, v, v)
    _assert_full(set_const, model)


def test_step(scene):
    model, state, ctrl = scene
    for f in jaxsim.step, jaxsim.forward:
        _assert_full(f, model, state, ctrl)
    _assert_full(jaxsim.inverse, model, state, state.qvel)
    _assert_full(jaxsim.rollout, model, state, ctrl[None])


def test_derivatives(scene):
    """Those taken of a compiled step too, whose rules are traced after it."""
    model, state, ctrl = scene
    moved = lambda ctrl: jax.jit(jaxsim.step)(model, state, ctrl).qvel  # noqa: E731
    _assert_full(jax.jacfwd(moved), ctrl)
    _assert_full(jax.jacrev(moved), ctrl)


def test_batch(scene):
    model, state, ctrl = scene
    states = jax.tree.map(lambda x: jnp.stack([x, x]), state)
    ctrls = jnp.stack([ctrl, ctrl])
    for vmap in jaxsim.vmap, jax.vmap:
        _assert_full(vmap(lambda s, u: jaxsim.step(model, s, u)), states, ctrls)


def test_environment():
    env = make("hopper")
    state = env.reset(jax.random.key(0))
    _assert_full(env.step, state, jnp.zeros(env.action_size))


def test_the_rest_is_left_alone():
    """What a user multiplies, and the setting itself, are as before."""
    x = jnp.eye(3)
    user = lambda x: full_precision(jnp.matmul)(x, x) @ x  # noqa: E731
    first, second = _products(jax.make_jaxpr(user)(x).jaxpr)
    assert first != second
    assert second is None
    assert jax.config.jax_default_matmul_precision is None
