"""One decision for a batch, under every transformation that meets it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

import jaxsim
from jaxsim.batching.anywhere import anywhere, in_lanes, place, pushing


def larger(x):
    """Adds 10 to everything where something in the batch is positive."""
    return lax.cond(anywhere(x > 0), lambda x: x + 10, lambda x: x, x)


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
    found = vmap(lambda x: anywhere(x > 0), out_axes=None)(x)
    np.testing.assert_array_equal(found, [False, True, False])


def test_alone_it_is_the_identity():
    assert anywhere(jnp.array(True))
    assert not jax.jit(anywhere)(jnp.array(False))
    assert larger(jnp.array(2.0)) == 12


@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
def test_a_batch_without_the_operand_is_not_asked(vmap):
    """What no element changes stays one value."""
    out = vmap(lambda x, y: (anywhere(y > 0), x), in_axes=(0, None), out_axes=(None, 0))
    found, _ = out(jnp.ones(3), jnp.array(1.0))
    assert found.shape == ()
    assert found


@pytest.mark.parametrize("wrap", [lambda f: f, jax.jit])
def test_lanes_are_those_of_our_own_batches(wrap):
    x = jnp.ones(3)
    together = lambda vmap, **axes: wrap(vmap(in_lanes, out_axes=None, **axes))  # noqa: E731
    assert together(jaxsim.vmap)(x)
    assert not together(jax.vmap)(x)
    assert not wrap(in_lanes)(x[0])
    assert not wrap(
        jaxsim.vmap(lambda x, y: (in_lanes(y), x), out_axes=(None, 0), in_axes=(0, None))
    )(x, 1.0)[0]


@pytest.mark.parametrize("inner", [jax.vmap, jaxsim.vmap])
@pytest.mark.parametrize("outer", [jax.vmap, jaxsim.vmap])
def test_lanes_of_batches_of_batches(inner, outer):
    found = outer(inner(in_lanes, out_axes=None), out_axes=None)(jnp.ones((2, 3)))
    assert found == (jaxsim.vmap in (inner, outer))


def test_what_only_repays_in_lanes_is_not_compiled_elsewhere():
    f = lambda x: lax.cond(in_lanes(x) & (x < 9), jnp.sin, jnp.cos, x)  # noqa: E731
    assert " sine(" not in jax.jit(f).lower(1.0).compile().as_text()
    assert jax.jvp(f, (1.0,), (1.0,))[1] == -jnp.sin(1.0)


@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
def test_derivatives_pass_by(vmap):
    def f(x):
        return lax.cond(anywhere(x > 1), lambda x: x**3, lambda x: x**2, x)

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


def test_pushing_and_place_find_what_has_a_weight_anywhere():
    W = jnp.zeros((2, 5, 3)).at[0, 1, 2].set(-1.0).at[1, 3, 0].set(2.0).at[1, 1].set(1.0)

    def found(W):
        rank = jnp.cumsum(pushing(W))
        return jax.vmap(lambda i: place(rank, i))(jnp.arange(3))

    np.testing.assert_array_equal(jax.vmap(found)(W), [[1, 3, 5]] * 2)
    np.testing.assert_array_equal(found(W[0]), [1, 5, 5])
