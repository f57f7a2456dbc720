"""Functions with derivatives of their own, deliberately not the true ones."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from vmap_compare import assert_same

from jaxsim.batching import vmap

pytestmark = pytest.mark.usefixtures("x64")
RNG = np.random.default_rng(3)
X = RNG.normal(size=(5, 3))


@jax.custom_jvp
def sine(x, y):
    """Claims the derivative 7 cos(x) y dx."""
    return jnp.sin(x), y


@sine.defjvp
def _sine_jvp(primals, tangents):
    (x, y), (dx, dy) = primals, tangents
    return sine(x, y), (7 * jnp.cos(x) * y * dx, dy)


@partial(jax.custom_vjp, nondiff_argnums=(2,))
def product(x, n, scale):
    """Claims the gradient 5 scale x c; n is an integer."""
    return scale * x * n, n + 1


product.defvjp(
    lambda x, n, scale: (product(x, n, scale), (x, n)),
    lambda scale, saved, c: (5 * scale * saved[0] * c[0], None),
)


def test_custom_jvp():
    """Batched and shared operands, both modes."""
    assert_same(lambda x: sine(x, 2.0), X)
    assert_same(lambda x, y: sine(x, y), X, X)
    assert_same(lambda x, y: sine(y, x), X, X[0], in_axes=(0, None))


def test_custom_vjp():
    """With integer operands and results, and with a shared operand, whose gradient is summed."""
    n = jnp.arange(5)
    assert_same(lambda x, n: product(x, n, 3.0), X, n, derivatives=("vjp",))
    assert_same(lambda x, n: product(x, n, 3.0), X[0], n, in_axes=(None, 0), derivatives=("vjp",))
    assert_same(lambda x: product(x, 4, 3.0)[0], X, derivatives=("vjp",))


def test_forward_mode_of_custom_vjp_is_refused():
    """As always."""
    with pytest.raises(TypeError, match="forward-mode"):
        jax.jvp(vmap(lambda x: product(x, 2, 1.0)[0]), (X,), (X,))


def test_within_control_flow():
    """In scan, cond, checkpoint, jit and nested calls."""

    def f(x):
        y = lax.scan(lambda c, r: (sine(c, r)[0], c), x, x)[1]
        y = jax.checkpoint(lambda y: sine(y, 3.0)[0])(y)
        y = lax.cond(x[0] > 0, lambda y: sine(y, 2.0)[0], lambda y: y, y)
        return jax.jit(lambda y: sine(sine(y, y)[0], 1.0))(y)

    assert_same(f, X)

    def g(x):
        y = lax.scan(lambda c, r: (product(c, 2, 0.5)[0] + r, c), x, x)[1]
        return jax.checkpoint(lambda y: product(y, 3, 0.1)[0])(y)

    assert_same(g, X, derivatives=("vjp",))


def test_rule_with_constants():
    """A rule that closes over arrays, and one within another."""
    table = jnp.arange(3.0)

    @jax.custom_jvp
    def inner(y):
        return y * table

    @jax.custom_jvp
    def outer(y):
        return inner(y) + table

    inner.defjvp(lambda p, t: (inner(p[0]), 11 * t[0] * table))
    outer.defjvp(lambda p, t: (outer(p[0]), jax.jvp(inner, p, t)[1] * p[0]))
    assert_same(outer, X)


def test_symbolic_zeros():
    """Rules that ask which operands move are asked in the same way."""

    @jax.custom_jvp
    def f(x, y):
        return x * y

    def rule(primals, tangents):
        x, y = primals
        moving = [not isinstance(t, jax.custom_derivatives.SymbolicZero) for t in tangents]
        out = 3 * tangents[0] * y if moving[0] else jnp.zeros_like(x)
        return f(x, y), out + (5 * tangents[1] * x if moving[1] else 0.0)

    f.defjvp(rule, symbolic_zeros=True)
    assert_same(lambda x: f(x, 2.0), X)
    assert_same(lambda x: f(x, x + 1), X)


def test_second_derivatives():
    """A derivative of the claimed derivative."""
    assert_same(jax.grad(lambda x: jnp.sum(sine(x, x)[0])), X, derivatives=("jvp",))

    def hessian(batch):
        return jax.jacfwd(jax.grad(lambda x: jnp.sum(batch(lambda x: sine(x, x)[0])(x))))(X)

    np.testing.assert_allclose(hessian(vmap), hessian(jax.vmap), rtol=1e-10)


def test_library_functions_with_rules():
    """relu, logsumexp, and safe norms."""

    def f(x):
        return [
            jax.nn.relu(x),
            jax.nn.silu(x),
            jax.nn.logsumexp(x),
            jax.nn.relu6(x),
            jax.nn.gelu(x),
        ]

    assert_same(f, X)


def test_implicit_functions():
    """Roots and linear solves, whose derivatives are solves."""

    def root(x):
        def newton(f, y):
            return lax.fori_loop(0, 8, lambda _, y: y - jnp.linalg.solve(jax.jacfwd(f)(y), f(y)), y)

        def tangent_solve(g, y):
            return jnp.linalg.solve(jax.jacfwd(g)(y), y)

        return lax.custom_root(lambda y: y + 0.1 * y**3 - x, x, newton, tangent_solve)

    assert_same(root, X, tolerance=1e-8)

    def linear(x):
        a = jnp.eye(3) * 2 + 0.1 * jnp.outer(x, x) + jnp.diag(x[:2], 1) * 0.1
        solve = lambda _, b: jnp.linalg.inv(a) @ b  # noqa: E731
        transposed = lambda _, b: jnp.linalg.inv(a).T @ b  # noqa: E731
        return lax.custom_linear_solve(lambda y: a @ y, x, solve, transposed)

    assert_same(linear, X, tolerance=1e-8)


def test_custom_batching():
    """A `custom_vmap` function is asked for its batch rule."""

    @jax.custom_batching.custom_vmap
    def f(x):
        return x * 2

    @f.def_vmap
    def _rule(size, batched, x):
        return x * 100 + size, batched[0]

    np.testing.assert_array_equal(vmap(f)(X), jax.vmap(f)(X))
