"""Derivatives of the solution: against differences, other modes, and the unrolled loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.solver import attach, solve

WEIGHT = np.arange(1.0, 8.0)
OPTIONS = {
    "iterations": 30,
    "ls_iterations": 20,
    "tolerance": 0.0,
    "ls_tolerance": 0.01,
    "scale": 1,
}


@pytest.fixture
def theta(x64, random_case):
    """Everything in a problem: blocks, operator, force."""
    return random_case(5)


@pytest.fixture
def minimiser(solve_tight):
    """Function from theta to the converged solution, without derivatives."""
    return lambda theta: solve_tight(*theta).x


def direction(theta, seed):
    """A random perturbation that keeps the mass matrix symmetric."""
    rng = np.random.default_rng(seed)
    problem, operator, force = jax.tree.map(lambda a: jnp.asarray(rng.normal(size=a.shape)), theta)
    return problem, operator.replace(mass=operator.mass + operator.mass.T), force


def move(theta, step, t):
    return jax.tree.map(lambda a, b: a + t * b, theta, step)


def only(step, name):
    """The part of a perturbation that belongs to leaves of one name."""

    def keep(path, leaf):
        return leaf if name in jax.tree_util.keystr(path) else jnp.zeros_like(leaf)

    return jax.tree_util.tree_map_with_path(keep, step)


@jax.jit
def tangent_of(x, theta, step):
    return jax.jvp(lambda theta: attach(x, *theta), (theta,), (step,))[1]


LEAVES = ["mass", "jacobian", "aref", ".D", ".mu", ".friction", "floss", "[2]"]


def test_derivatives_equal_central_differences(theta, minimiser):
    """Program-exact, parameter by parameter, along a random direction each."""
    x, h = minimiser(theta), 1e-6
    for seed, name in enumerate(LEAVES):
        step = only(direction(theta, seed), name)
        tangent = tangent_of(x, theta, step)
        assert np.any(tangent), name
        difference = (minimiser(move(theta, step, h)) - minimiser(move(theta, step, -h))) / (2 * h)
        scale = max(1.0, np.abs(tangent).max())
        np.testing.assert_allclose(tangent, difference, atol=1e-6 * scale, err_msg=name)


def test_reverse_equals_forward_mode(theta, minimiser):
    x, step = minimiser(theta), direction(theta, 0)
    gradient = jax.jit(jax.grad(lambda theta: WEIGHT @ attach(x, *theta)))(theta)
    products = jax.tree.map(lambda a, b: jnp.sum(a * b), gradient, step)
    forward = WEIGHT @ tangent_of(x, theta, step)
    np.testing.assert_allclose(sum(jax.tree.leaves(products)), forward, rtol=1e-10)


def test_derivative_of_solving_and_attaching_in_one_program(theta, minimiser):
    """The loop is not differentiated, so reverse mode passes it."""

    def total(theta, guess):
        found = solve(*theta, guess, **OPTIONS)
        return WEIGHT @ attach(found.x, *theta)

    guess = theta[2] + 0.1
    whole, of_guess = jax.jit(jax.grad(total, (0, 1)))(theta, guess)
    x = minimiser(theta)
    alone = jax.jit(jax.grad(lambda theta: WEIGHT @ attach(x, *theta)))(theta)
    for a, b in zip(jax.tree.leaves(whole), jax.tree.leaves(alone), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10)
    assert not np.any(of_guess)


def test_vmap_of_the_derivative(theta, minimiser):
    x, steps = minimiser(theta), [direction(theta, seed) for seed in range(3)]
    batch = jax.tree.map(lambda *a: jnp.stack(a), *steps)
    together = jax.vmap(tangent_of, (None, None, 0))(x, theta, batch)
    for i, step in enumerate(steps):
        np.testing.assert_allclose(together[i], tangent_of(x, theta, step), rtol=1e-10, atol=1e-12)


def test_second_derivatives_equal_central_differences(theta, minimiser):
    """Along a path in all parameters; the rule is differentiated once more, both ways."""
    step, h = direction(theta, 3), 1e-5

    def objective(t, x):
        return jnp.sum(WEIGHT * attach(x, *move(theta, step, t)) ** 2)

    def slope(t):
        return first(t, minimiser(move(theta, step, t)))

    first, x = jax.jit(jax.grad(objective)), minimiser(theta)
    difference = (slope(h) - slope(-h)) / (2 * h)
    np.testing.assert_allclose(jax.jit(jax.hessian(objective))(0.0, x), difference, rtol=1e-6)
    np.testing.assert_allclose(jax.jit(jax.jacrev(first))(0.0, x), difference, rtol=1e-6)


def test_the_unrolled_loop_has_the_same_derivative(theta, minimiser):
    """Newton's method differentiated step by step, from a point in the solution's zones."""
    x, step = minimiser(theta), direction(theta, 4)

    def iterate(x, theta):
        problem, operator, force = theta
        y = operator.lift(x)
        rows = operator.rows(y)
        residual = force + operator.residual(y, problem.forces(rows))
        return x + operator.solve(problem.curvatures(rows), residual)[0].x

    advance = jax.jit(lambda x, dx: jax.jvp(iterate, (x, theta), (dx, step)))
    unrolled, slow = x + 1e-3, jnp.zeros_like(x)
    for _ in range(4):
        unrolled, slow = advance(unrolled, slow)
    np.testing.assert_allclose(unrolled, x, atol=1e-12)
    np.testing.assert_allclose(tangent_of(x, theta, step), slow, rtol=1e-9, atol=1e-11)


def test_the_value_costs_no_further_solve(theta):
    force = theta[2]
    compiled = jax.jit(attach).lower(force, *theta).compile().as_text()
    assert "cholesky" not in compiled
    assert "dot(" not in compiled
    np.testing.assert_array_equal(attach(force, *theta), force)


def test_inactive_rows_have_no_derivative(theta):
    """Padding moves nothing, whatever its reference and Jacobian."""
    problem, operator, force = theta
    padding = jax.tree.map(jnp.zeros_like, problem), operator, force
    gradient = jax.jit(jax.grad(lambda theta: jnp.sum(attach(force, *theta))))(padding)
    for name in ("aref", ".mu", ".friction", "floss", "jacobian"):
        assert not any(np.any(leaf) for leaf in jax.tree.leaves(only(gradient, name))), name
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))
    np.testing.assert_allclose(operator.mass @ gradient[2], 1.0, rtol=1e-10)
