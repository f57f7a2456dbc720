"""Sums of padded arrays: all ways in which parts can lie, and what a backward pass makes of it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import jaxsim
from jaxsim.arrays import tuning
from jaxsim.batching.padded_sum import PaddedSum

SHAPE = (5, 4, 3)


@st.composite
def places(draw):
    """Boxes within SHAPE; the last axis, that of the lanes, is always full."""
    sides = []
    for size in SHAPE[:-1]:
        low = draw(st.integers(0, size - 1))
        sides.append((low, draw(st.integers(low + 1, size))))
    return sides


@given(st.lists(places(), min_size=1, max_size=6), st.booleans())
def test_the_sum_of_the_parts(boxes, with_a_whole):
    rng = np.random.default_rng(0)
    expected, found = np.zeros(SHAPE), None
    for (a, b), (c, d) in boxes:
        x = rng.integers(-9, 9, (b - a, d - c, SHAPE[-1])).astype(float)
        expected[a:b, c:d] += x
        part = PaddedSum(SHAPE, (((a, c, 0), jnp.asarray(x)),))
        found = part if found is None else found.plus(part)
    if with_a_whole:
        whole = rng.integers(-9, 9, SHAPE).astype(float)
        expected, found = expected + whole, found.plus(jnp.asarray(whole))
    np.testing.assert_array_equal(found.force(), expected)


def test_more_regions_than_are_worth_it():
    size = tuning.PADDED_REGIONS + 2
    ones = jnp.ones((1, 2))
    parts = [PaddedSum((size, 2), (((i, 0), ones),)) for i in range(0, size, 2)]
    found = parts[0]
    for part in parts[1:]:
        found = found.plus(part)
    np.testing.assert_array_equal(found.force()[:, 0], np.arange(size) % 2 == 0)


def quaternion_like(x):
    w, a, b, c = x[0], x[1], x[2], x[3]
    return jnp.stack([w * a - b * c, w * b + a * c, w * c]).sum() * x[1:3].sum()


def overlapping(x):
    return jnp.prod(x[:3]) + jnp.prod(x[1:]) + jnp.sum(x * x)


def twice(x):
    """The cotangent of y is used twice: it is put together for both."""
    y = jnp.sin(x)
    return y[0] * y[2] + jnp.sum(y[1:] ** 3)


@pytest.mark.parametrize("f", [quaternion_like, overlapping, twice])
def test_gradients(f, x64):
    x = jax.random.normal(jax.random.key(0), (7, 4))
    np.testing.assert_allclose(
        jax.jit(jaxsim.vmap(jax.grad(f)))(x), jax.vmap(jax.grad(f))(x), rtol=1e-12
    )
    second = jaxsim.vmap(jax.hessian(f))(x)
    np.testing.assert_allclose(second, jax.vmap(jax.hessian(f))(x), rtol=1e-12, atol=1e-12)


def test_the_backward_pass_pads_nothing():
    x = jnp.ones((7, 4))
    program = jax.make_jaxpr(jaxsim.vmap(jax.grad(quaternion_like)))(x)
    names = [eqn.primitive.name for eqn in program.jaxpr.eqns]
    assert "pad" not in names
    assert "concatenate" in names


def test_padding_that_is_not_with_zeros():
    pad = lambda x: jnp.pad(x, (1, 2), constant_values=3.0)  # noqa: E731
    crop = lambda x: jax.lax.pad(x, 0.0, [(-1, 2, 0)])  # noqa: E731
    spread = lambda x: jax.lax.pad(x, 0.0, [(1, 0, 2)])  # noqa: E731
    x = jax.random.normal(jax.random.key(0), (7, 4))
    for f in (pad, crop, spread):
        np.testing.assert_array_equal(jaxsim.vmap(f)(x), jax.vmap(f)(x))
