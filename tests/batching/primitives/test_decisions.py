"""One decision for a batch, under every transformation that meets it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxsim
from jaxsim.batching.primitives.decisions import (
    any_in_batch,
    index_of_nth,
    is_batched,
    nonzero_in_batch,
)


def larger(x):
    """Adds 10 to everything where something in the batch is positive."""
    return lax.cond(any_in_batch(x > 0), lambda x: x + 10, lambda x: x, x)


@pytest.mark.parametrize("wrap", [lambda f: f, jax.jit])
@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
@pytest.mark.parametrize(("x", "added"), [([-1.0, -2, -3], 0), ([-1.0, 2, -3], 10)])
def test_a_batch_decides_together(vmap, wrap, x, added):
    x = jnp.array(x)
    np.testing.assert_array_equal(wrap(vmap(larger))(x), x + added)


@pytest.mark.parametrize("outer", [jax.vmap, jaxsim.vmap])
@pytest.mark.parametrize("inner", [jax.vmap, jaxsim.vmap])
def test_batches_of_batches(inner, outer):
    x = -jnp.ones((2, 3))
    np.testing.assert_array_equal(outer(inner(larger))(x), x)
    x = x.at[1, 2].set(1.0)
    np.testing.assert_array_equal(outer(inner(larger))(x), x + 10)


@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
def test_several_questions_at_once(vmap):
    x = jnp.array([[-1.0, 2, -3], [-4, 5, -6]])
    found = vmap(lambda x: any_in_batch(x > 0), out_axes=None)(x)
    np.testing.assert_array_equal(found, [False, True, False])


def test_alone_it_is_the_identity():
    assert any_in_batch(jnp.array(True))
    assert not jax.jit(any_in_batch)(jnp.array(False))
    assert larger(jnp.array(2.0)) == 12


@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
def test_a_batch_without_the_operand_is_not_asked(vmap):
    """What no element changes stays one value."""
    out = vmap(lambda x, y: (any_in_batch(y > 0), x), in_axes=(0, None), out_axes=(None, 0))
    found, _ = out(jnp.ones(3), jnp.array(1.0))
    assert found.shape == ()
    assert found


@pytest.mark.parametrize("wrap", [lambda f: f, jax.jit])
def test_lanes_are_those_of_our_own_batches(wrap):
    x = jnp.ones(3)
    together = lambda vmap, **axes: wrap(vmap(is_batched, out_axes=None, **axes))  # noqa: E731
    assert together(jaxsim.vmap)(x)
    assert not together(jax.vmap)(x)
    assert not wrap(is_batched)(x[0])
    assert not wrap(
        jaxsim.vmap(lambda x, y: (is_batched(y), x), out_axes=(None, 0), in_axes=(0, None))
    )(x, 1.0)[0]


@pytest.mark.parametrize("inner", [jax.vmap, jaxsim.vmap])
@pytest.mark.parametrize("outer", [jax.vmap, jaxsim.vmap])
def test_lanes_of_batches_of_batches(inner, outer):
    found = outer(inner(is_batched, out_axes=None), out_axes=None)(jnp.ones((2, 3)))
    assert found == (jaxsim.vmap in (inner, outer))


def test_what_only_repays_in_lanes_is_not_compiled_elsewhere():
    f = lambda x: lax.cond(is_batched(x) & (x < 9), jnp.sin, jnp.cos, x)  # noqa: E731
    assert " sine(" not in jax.jit(f).lower(1.0).compile().as_text()
    assert jax.jvp(f, (1.0,), (1.0,))[1] == -jnp.sin(1.0)


@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
def test_derivatives_pass_by(vmap):
    def f(x):
        return lax.cond(any_in_batch(x > 1), lambda x: x**3, lambda x: x**2, x)

    x = jnp.array([0.5, 1.5])
    np.testing.assert_allclose(vmap(jax.grad(f))(x), 3 * x**2, rtol=1e-6)
    np.testing.assert_allclose(jax.grad(lambda x: vmap(f)(x).sum())(x / 2), x, rtol=1e-6)
    _, tangent = jax.jvp(vmap(f), (x,), (jnp.ones(2),))
    np.testing.assert_allclose(tangent, 3 * x**2, rtol=1e-6)


def test_in_a_loop():
    """A batch goes on adding ten while one of its elements is positive."""

    def f(x):
        return lax.fori_loop(0, 2, lambda _, x: larger(x) - 11, x)

    x = jnp.array([0.5, -3.0])
    np.testing.assert_array_equal(jaxsim.vmap(f)(x), x - 12)
    np.testing.assert_array_equal(jax.vmap(f)(x), x - 12)


def test_rows_with_a_weight_anywhere_in_the_batch_are_found():
    W = jnp.zeros((2, 5, 3)).at[0, 1, 2].set(-1.0).at[1, 3, 0].set(2.0).at[1, 1].set(1.0)

    def found(W):
        rank = jnp.cumsum(nonzero_in_batch(W))
        return jax.vmap(lambda i: index_of_nth(rank, i))(jnp.arange(3))

    np.testing.assert_array_equal(jax.vmap(found)(W), [[1, 3, 5]] * 2)
    np.testing.assert_array_equal(found(W[0]), [1, 5, 5])
