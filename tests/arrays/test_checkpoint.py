"""`jaxsim.checkpoint`: the same gradients, without a second solve, in the memory of the states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.extend import core as jex
from leg import LEG
from oracle import quick_jit

import jaxsim

STEPS = 8


def loops(program) -> int:
    """Number of `while` equations in a program and all that it calls."""
    count = 0
    for eqn in program.eqns:
        count += eqn.primitive.name == "while"
        for parameter in eqn.params.values():
            for part in parameter if isinstance(parameter, tuple | list) else [parameter]:
                if isinstance(part, jex.ClosedJaxpr):
                    count += loops(part.jaxpr)
                elif isinstance(part, jex.Jaxpr):
                    count += loops(part)
    return count


@pytest.fixture(scope="module")
def leg():
    """A model whose solver iterates, standing on the ground."""
    model = jaxsim.load(LEG)
    state = jaxsim.make_state(model)
    return model, state.replace(qvel=state.qvel + 0.1), jnp.full((model.nu,), 0.3)


def test_nothing_is_solved_twice(leg):
    model, state, ctrl = leg

    def loss(wrap):
        return lambda ctrl: jnp.sum(wrap(jaxsim.step)(model, state, ctrl).qvel)

    program = lambda f: jax.make_jaxpr(f)(ctrl).jaxpr  # noqa: E731
    once = loops(program(loss(lambda f: f)))
    assert once > 0
    assert loops(program(jax.grad(loss(jaxsim.checkpoint)))) == once
    assert loops(program(jax.grad(loss(jax.checkpoint)))) == 2 * once


def test_same_gradient(x64):
    model = jaxsim.load(LEG)
    state = jaxsim.make_state(model)

    def loss(f):
        def body(state, ctrl):
            return f(model, state, ctrl), None

        return lambda ctrls: jnp.sum(jax.lax.scan(body, state, ctrls)[0].qpos ** 2)

    ctrls = 0.5 * jax.random.normal(jax.random.key(0), (STEPS, model.nu))
    plain = quick_jit(jax.grad(loss(jaxsim.step)))(ctrls)
    kept = quick_jit(jax.grad(loss(jaxsim.checkpoint(jaxsim.step))))(ctrls)
    assert np.abs(plain).max() > 0
    # Both are the same formulas, summed in another order.
    np.testing.assert_allclose(kept, plain, rtol=1e-9, atol=1e-12)


def test_a_rollout_remembers_states(leg):
    """Numbers kept for the backward pass, per step: about those of a state."""
    model, state, ctrl = leg
    ctrls = jnp.tile(ctrl, (STEPS, 1))
    _, backward = jax.vjp(lambda u: jaxsim.rollout(model, state, u), ctrls)
    kept = sum(x.size for x in jax.tree.leaves(backward) if jnp.ndim(x) and x.shape[0] == STEPS)
    of_a_state = sum(x.size for x in jax.tree.leaves(state))
    assert kept <= STEPS * (of_a_state + model.nv + model.nu + 8)
