"""Reverse mode by a kernel: the cotangents are those of XLA's derivative."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from oracle import quick_jit

import jaxsim
from jaxsim.gradients import Backward
from jaxsim.lanes import with_pullback_kernel

RNG = np.random.default_rng(5)
X = jnp.asarray(RNG.normal(size=(37, 3)), jnp.float32)


def f(x, count):
    """A loop whose iterations stay a loop and store something, and an integer."""

    def body(y, _):
        return jax.checkpoint(lambda y: 0.9 * jnp.sin(y) + jnp.outer(x, x) @ y)(y), y

    y, rows = lax.scan(body, x * count, None, 300)
    return {"y": y, "sum": jnp.sum(rows[:3] ** 2), "count": count + 1}


def test_cotangents():
    """Those of floating point are XLA's, and the others have none."""
    small = 0.2 * X

    def loss(through):
        def total(x):
            out = jaxsim.vmap(through)(x, jnp.arange(len(x)))
            return jnp.sum(jnp.sin(out["y"])) + jnp.sum(out["sum"])

        return quick_jit(jax.value_and_grad(total))(small)

    found, expected = loss(with_pullback_kernel(f)), loss(f)
    np.testing.assert_allclose(found[0], expected[0], rtol=1e-5)
    np.testing.assert_allclose(found[1], expected[1], rtol=1e-4, atol=1e-5)


BALL = """
<mujoco>
  <option timestep=".01" integrator="RK4"/>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 .09"><freejoint/><geom type="sphere" size=".1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def kernels():
    """Steps are kernels."""
    from jaxsim.lanes import switch

    before = switch._enabled
    switch.enable_lanes(True)
    yield
    switch.enable_lanes(before)


@pytest.mark.slow
def test_a_step_in_contact(kernels):
    """A ball that rolls and sinks in has the derivative of the plain step."""
    speeds = jnp.asarray(RNG.normal(size=(20, 6)), jnp.float32)

    def gradient(model):
        start = jaxsim.make_state(model)

        def travel(v):
            state = jax.vmap(lambda v: start.replace(qvel=v))(v)
            step = jaxsim.vmap(lambda s: jaxsim.step(model, s))
            state, _ = lax.scan(lambda s, _: (step(s), None), state, length=5)
            return jnp.sum(state.qpos[:, 0] + state.qpos[:, 2] * state.qvel[:, 1])

        return quick_jit(jax.grad(travel))(speeds)

    expected = gradient(jaxsim.load(BALL))
    found = gradient(jaxsim.load(BALL, backward=Backward(reverse_only=True)))
    np.testing.assert_allclose(found, expected, rtol=1e-3, atol=1e-5 * np.abs(expected).max())
