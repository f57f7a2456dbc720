"""Functions that compile themselves: once, and only outside of JAX's transformations."""

import jax
import jax.numpy as jnp

import jaxsim
from jaxsim.arrays.whole import as_a_whole


def test_a_call_compiles_once_and_inside_of_jit_nothing():
    seen = []

    @as_a_whole
    def f(x):
        seen.append(type(x))
        return jax.lax.fori_loop(0, 3, lambda _, y: y + x, x)

    assert f(1.0) == f(1.0) == 4.0
    assert len(seen) == 1
    inside = jax.make_jaxpr(f)(1.0)
    assert len(seen) == 2
    assert "pjit" not in str(inside)
    assert "jit" not in {eqn.primitive.name for eqn in inside.eqns}


def test_a_step_outside_of_jit_is_not_compiled_again(caplog):
    """Its loops would be, at every call."""
    model = jaxsim.load("pendulum")
    state = jaxsim.step(model, jaxsim.make_state(model), jnp.ones(1))
    with jax.log_compiles():
        state = jaxsim.step(model, state, jnp.ones(1))
    assert not [r for r in caplog.records if "ompil" in r.getMessage()]
    assert float(state.time) == 2 * float(model.opt.timestep)
