"""Gradients over many steps of linear systems, whose products are known."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from oracle import quick_jit

import jaxsim
from jaxsim.gradients import (
    clip_cotangent,
    gradient_norms,
    stop_cotangent,
    truncate,
    usable_horizon,
)


def test_norms_of_a_growing_system(x64):
    """`x' = 1.5 x + u` and loss `w x_T`: the gradient at x_t is `w 1.5^(T - t)`."""
    norms = quick_jit(
        lambda: gradient_norms(
            lambda x, u: 1.5 * x + u, lambda x: 2 * x, jnp.array(1.0), np.ones(8)
        )
    )()
    np.testing.assert_allclose(norms, 2 * 1.5 ** np.arange(8.0, -1, -1))
    assert usable_horizon(norms, growth=10.0) == 5  # 1.5^5 < 10 < 1.5^6
    assert usable_horizon(norms.at[6].set(jnp.nan)) == 1


def test_windows_and_clipping(x64):
    """A window ends the product; clipping keeps its direction and drops what is not finite."""

    def loss(x, every, limit):
        def body(x, t):
            x = truncate(x, t % every == 0)
            return clip_cotangent(2 * x, limit), None

        return lax.scan(body, x, jnp.arange(6))[0] @ jnp.array([3.0, 4.0])

    x = jnp.ones(2)
    # Cut before steps 0 and 4: nothing passes. Without a cut, three doublings do.
    np.testing.assert_array_equal(quick_jit(jax.grad(lambda x: loss(x, 4, 1e9)))(x), 0)
    inner = lambda x: lax.scan(lambda x, t: (2 * truncate(x, t < 0), None), x, jnp.arange(3))[0]  # noqa: E731
    np.testing.assert_array_equal(quick_jit(jax.grad(lambda x: inner(x).sum()))(x), 8)

    def clipped(x, limit):
        body = lambda x, _: (clip_cotangent(2 * x, limit), None)  # noqa: E731
        return lax.scan(body, x, None, length=6)[0] @ jnp.array([3.0, 4.0])

    gradient = quick_jit(jax.grad(clipped))
    np.testing.assert_allclose(gradient(x, 1e9), 64 * np.array([3.0, 4.0]))
    np.testing.assert_allclose(gradient(x, 10.0), 20 * np.array([0.6, 0.8]))
    bad = jax.grad(lambda x: jnp.sqrt(jnp.sum(clip_cotangent(x, 1.0) ** 2)))
    np.testing.assert_array_equal(bad(jnp.zeros(2)), 0)


def test_a_horizon_that_ends_where_the_gradient_grows(x64):
    """Of inputs to `x' = 2 x + u`, each environment's last ones have a gradient below the limit."""

    def loss(inputs, weight):
        body = lambda x, u: (2 * stop_cotangent(x, 10.0) + u, None)  # noqa: E731
        return weight * lax.scan(body, jnp.zeros(()), inputs)[0]

    found = quick_jit(jax.vmap(jax.grad(loss), (None, 0)))(jnp.zeros(6), jnp.array([1.0, 4.0]))
    np.testing.assert_array_equal(found, [[0, 0, 8, 4, 2, 1], [0, 0, 0, 0, 8, 4]])
    np.testing.assert_array_equal(stop_cotangent(jnp.ones(2), 0.1), 1)


NO_LIMIT = 1e18


def gradient_through(scale, limit):
    """Gradient of `scale . x` behind a limit, for a tree with an integer in it."""

    def f(x):
        tree = clip_cotangent({"x": x, "n": jnp.arange(3)}, limit)
        return scale @ tree["x"] + tree["n"].sum()

    return jax.grad(f)(jnp.zeros(2))


def test_clipping_is_the_identity():
    tree = {"x": jnp.array([1.0, -2.0]), "n": jnp.arange(3)}
    assert jax.tree.all(jax.tree.map(lambda a, b: (a == b).all(), clip_cotangent(tree, 1.0), tree))


@pytest.mark.parametrize(
    ("scale", "expected"),
    [
        ([3.0, 4.0], [0.6, 0.8]),
        ([0.3, 0.4], [0.3, 0.4]),
        ([0.0, 0.0], [0.0, 0.0]),
        ([np.nan, 1.0], [0.0, 0.0]),
        ([np.inf, 1.0], [0.0, 0.0]),
    ],
)
def test_gradients_are_scaled_down_to_the_limit(scale, expected):
    got = gradient_through(jnp.array(scale), 1.0)
    np.testing.assert_allclose(got, jnp.array(expected), rtol=1e-6)


def test_one_environment_that_breaks_does_not_poison_the_others():
    """The derivative of sqrt at zero is infinite, times zero a NaN."""
    one = lambda x: 0 * jnp.sqrt(clip_cotangent(x, NO_LIMIT)) + clip_cotangent(x, NO_LIMIT) ** 2  # noqa: E731
    got = jax.grad(lambda x: jaxsim.vmap(one)(x).sum())(jnp.array([3.0, 0.0, 5.0]))
    np.testing.assert_allclose(got, [6.0, 0.0, 10.0])
