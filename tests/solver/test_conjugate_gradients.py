"""Conjugate gradients: the same answers and derivatives as the dense solve."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dense_operator import DenseOperator
from flax import struct

from jaxsim.solver import attach, hessian_product, pcg, pcg_solve


@struct.dataclass
class MatrixFree(DenseOperator):
    """The dense operator with its solve replaced, preconditioned with the mass matrix."""

    def solve(self, curvatures, r):
        def precondition(r):
            return jnp.linalg.solve(self.mass, r)

        return pcg_solve(self, curvatures, r, precondition, tolerance=1e-14, iterations=40)


def matrix_free(operator):
    return MatrixFree(**{f.name: getattr(operator, f.name) for f in dataclasses.fields(operator)})


def test_hessian_product(x64, random_case):
    problem, operator, x = random_case(0)
    curvatures = problem.curvatures(operator.rows(operator.lift(x)))
    expected = operator.hessian(curvatures) @ x
    np.testing.assert_allclose(hessian_product(operator, curvatures, x), expected, rtol=1e-12)


def test_newton_with_conjugate_gradients(x64, random_case, solve_tight):
    problem, operator, force = random_case(1)
    dense = solve_tight(problem, operator, force)
    free = solve_tight(problem, matrix_free(operator), force)
    np.testing.assert_allclose(free.x, dense.x, atol=1e-10)


def test_derivatives(x64, random_case, solve_tight):
    """Reverse mode transposes the solve; second derivatives differentiate it."""
    problem, operator, force = random_case(1)
    x = solve_tight(problem, operator, force).x

    def total(jacobian, operator):
        return jnp.sum(attach(x, problem, operator.replace(jacobian=jacobian), force) ** 2)

    dense = jax.jit(jax.grad(total))(operator.jacobian, operator)
    free = jax.jit(jax.grad(total))(operator.jacobian, matrix_free(operator))
    for a, b in zip(dense, free, strict=True):
        np.testing.assert_allclose(b, a, atol=1e-10)


@pytest.mark.parametrize("size", [0, 1, 6])
def test_exact_after_as_many_products_as_unknowns(x64, size):
    factor = np.random.default_rng(0).normal(size=(size, size))
    A, b = jnp.asarray(factor @ factor.T + np.eye(size)), jnp.arange(1.0, size + 1)
    x, status = pcg(lambda x: A @ x, lambda r: r, b, 0.0, size)
    assert status.iterations == size
    np.testing.assert_allclose(A @ x, b, atol=1e-10)


def test_a_perfect_preconditioner_needs_one_product():
    A, b = jnp.diag(jnp.array([1.0, 10.0, 100.0])), jnp.ones(3)
    x, _ = pcg(lambda x: A @ x, lambda r: jnp.linalg.solve(A, r), b, 0.0, 1)
    np.testing.assert_allclose(A @ x, b, rtol=1e-6)


def test_zero_and_broken_systems_stay_finite():
    zero, done = pcg(lambda x: x, lambda r: r, jnp.zeros(3), 1e-6, 10)
    indefinite, negative = pcg(lambda x: -x, lambda r: r, jnp.ones(3), 1e-6, 10)
    broken, not_finite = pcg(lambda x: x * jnp.nan, lambda r: r, jnp.ones(3), 1e-6, 10)
    for x in (zero, indefinite, broken):
        np.testing.assert_array_equal(x, 0)
    assert done.converged
    assert not negative.converged
    assert not not_finite.converged


def test_status_says_when_iterations_run_out(x64):
    A, b = jnp.diag(jnp.arange(1.0, 7.0)), jnp.ones(6)
    for allowed, converged in ((5, False), (6, True), (20, True)):
        _, status = pcg(lambda x: A @ x, lambda r: r, b, 1e-12, allowed)
        assert status.converged == converged
        assert status.iterations == min(allowed, 6)


def test_newton_counts_the_inner_iterations(x64, random_case, solve_tight):
    problem, operator, force = random_case(1)
    plenty = solve_tight(problem, matrix_free(operator), force).status
    assert plenty.converged
    assert plenty.linear.converged
    assert plenty.linear.iterations > plenty.iterations
    short = solve_tight(problem, matrix_free(operator), force, iterations=1).status
    assert not short.converged
    direct = solve_tight(problem, operator, force).status
    assert direct.linear.iterations == 0
    assert direct.linear.converged
