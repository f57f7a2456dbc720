"""A derivative of a function's own is kept where JAX splits loops, in every mode and order."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from vmap_compare import assert_same

from jaxsim import batching
from jaxsim.batching.primitives.jvp_rule import with_jvp_rule

pytestmark = pytest.mark.usefixtures("x64")
MODES = jax.jacfwd, jax.jacrev
X = np.array([0.3, -0.7, 1.1])


def implicit(x, a):
    """The root x of x^3 + x = a: its value is given, its derivative 1 / (3 x^2 + 1)."""

    def rule(primals, tangents):
        x = implicit(*primals)
        return [x], [None if tangents[1] is None else tangents[1] / (3 * x**2 + 1)]

    return with_jvp_rule(lambda x, a: [x], rule)(x, a)[0]


def _root(a):
    """Cardano's formula, differentiable everywhere."""
    d = jnp.sqrt(a**2 / 4 + 1 / 27)
    return jnp.cbrt(a / 2 + d) + jnp.cbrt(a / 2 - d)


def one(a):
    return implicit(lax.stop_gradient(_root(a)), a)


def scanned(f):
    def total(x):
        carry, ys = lax.scan(lambda c, r: (f(c + r) * r, jnp.exp(c)), x[0] * x[1], x)
        return carry**2 + jnp.sum(ys)

    return total


def checkpointed(f):
    return scanned(jax.checkpoint(lambda x: jnp.sin(f(x))))


def batched(f, vmap):
    """A nonlinear sum over lanes, one of the operands shared."""
    return lambda x: jnp.sum(vmap(lambda r, s: scanned(f)(s * r), (0, None))(x, x) ** 2)


PROGRAMS = {
    "plain": lambda f: lambda x: jnp.prod(f(x)),
    "scan": scanned,
    "checkpoint": checkpointed,
    "jax.vmap": lambda f: batched(f, jax.vmap),
    "jaxsim.vmap": lambda f: batched(f, batching.vmap),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_second_derivatives_in_all_four_orders_of_modes(name):
    f, same = PROGRAMS[name](one), PROGRAMS[name](_root)
    expected = jax.jit(jax.hessian(same))(X)
    orders = list(itertools.product(MODES, MODES))
    found = jax.jit(lambda x: [second(first(f))(x) for first, second in orders])(X)
    for hessian in found:
        np.testing.assert_allclose(hessian, expected, rtol=1e-11, atol=1e-11)


def test_third_derivatives():
    f, same = scanned(one), scanned(_root)
    found, expected = (jax.jit(jax.jacfwd(jax.jacrev(jax.jacrev(g))))(X) for g in (f, same))
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("vmap", [jax.vmap, batching.vmap])
def test_batches_of_second_derivatives(vmap):
    f, same = scanned(one), scanned(_root)
    batch = np.stack([X, -X, X + 1])
    found = jax.jit(vmap(jax.hessian(f)))(batch)
    expected = jax.jit(jax.vmap(jax.hessian(same)))(batch)
    np.testing.assert_allclose(found, expected, rtol=1e-11, atol=1e-11)


def test_both_batches_agree():
    """Values and first derivatives, of one operand, several and shared ones."""
    assert_same(one, X)
    assert_same(implicit, X, X, derivatives=("jvp",))
    assert_same(implicit, X, 0.5, in_axes=(0, None), derivatives=("jvp",))


def test_a_function_of_tangents_is_transposed():
    """Its rule is that of a linear function of one operand."""

    def scaled(x, y):
        return with_jvp_rule(lambda x, y: [x * y, x + x], _scaled_rule)(x, y)

    def _scaled_rule(primals, tangents):
        _, y = primals
        return scaled(*primals), scaled(tangents[0], y)

    (back,) = jax.linear_transpose(lambda x: scaled(x, X), X)([X, X])
    np.testing.assert_allclose(back, X * X + 2 * X)
    (back,) = jax.linear_transpose(lambda x: scaled(x, X)[1], X)(X)  # one result without cotangent
    np.testing.assert_allclose(back, 2 * X)


def test_it_is_no_part_of_the_compiled_program():
    lowered = jax.jit(lambda x, a: implicit(x, a)).lower(X, X).as_text()
    assert "call" not in lowered
    assert "stablehlo" not in lowered.split("func.func")[1]
