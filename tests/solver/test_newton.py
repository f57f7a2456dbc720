"""Newton's method: agreement with MuJoCo, optimality, termination."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from dense_operator import DenseOperator
from flax import struct
from jaxtyping import Array, Float

from jaxsim.solver import Problem, Unilateral

SCENES = [("elliptic", 1.0), ("elliptic", 5.0), ("pyramidal", 1.0)]
every_scene = pytest.mark.parametrize(("cone", "impratio"), SCENES)


def relative(a, b):
    return np.abs(np.asarray(a) - b).max() / max(1.0, np.abs(b).max())


@every_scene
def test_agrees_with_mujoco(x64, scene, solve_tight, cone, impratio):
    case = scene(cone, impratio)
    solution = solve_tight(case.problem, case.operator, case.force, case.x_warm)
    forces = case.problem.forces(case.operator.rows(case.operator.lift(solution.x)))
    assert relative(solution.x, case.qacc) < 1e-6
    for ours, theirs in zip(forces, case.forces, strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6 * max(1, np.abs(theirs).max(initial=0)))
    np.testing.assert_allclose(solution.status.cost, case.cost, rtol=1e-9)
    assert case.scale * solution.status.residual < 1e-12
    assert solution.status.iterations < 30


@every_scene
def test_float32_agrees_with_mujoco(scene, solve_tight, cone, impratio):
    case = scene(cone, impratio)
    solution = solve_tight(case.problem, case.operator, case.force, case.x_warm)
    assert solution.x.dtype == jnp.float32
    assert relative(solution.x, case.qacc) < 1e-2
    assert solution.status.iterations < 30


@pytest.mark.parametrize("seed", range(4))
def test_the_gradient_of_the_objective_vanishes(x64, random_case, solve_tight, seed):
    problem, operator, force = random_case(seed)

    def objective(x):
        quadratic = 0.5 * x @ operator.mass @ x - force @ x
        return quadratic + problem.cost(operator.rows(operator.lift(x)))

    solution = solve_tight(problem, operator, force)
    least, gradient = jax.jit(jax.value_and_grad(objective))(solution.x)
    assert np.abs(gradient).max() < 1e-12
    np.testing.assert_allclose(solution.status.cost, least, rtol=1e-13)
    away = 0.1 * np.random.default_rng(0).normal(size=(20, force.size))
    assert (jax.jit(jax.vmap(objective))(solution.x[None] + away) > least).all()


def test_complementarity_of_unilateral_rows(x64, random_case, solve_tight):
    """With nearly rigid rows: no penetration, no pulling, and only one of them non-zero."""
    _, operator, force = random_case(0)
    problem = Problem((Unilateral(jnp.zeros(5), jnp.full(5, 1e8)),))
    operator = DenseOperator(operator.mass, operator.jacobian[2:3])
    solution = solve_tight(problem, operator, force)
    (r,), (f,) = (
        operator.rows(operator.lift(solution.x)),
        problem.forces(operator.rows(operator.lift(solution.x))),
    )
    assert (f >= 0).all()
    assert (f > 0).any()
    assert (r > -1e-6).all()
    assert np.abs(f * jnp.maximum(r, 0)).max() == 0


def test_the_cost_falls_with_every_iteration(x64, random_case, solve_tight):
    args = random_case(2)
    first = solve_tight(*args, iterations=1).x  # better than where that began
    counts = 0, 1, 4, 100
    states = [solve_tight(*args, first, iterations=count).status for count in counts]
    assert [state.iterations for state in states[:3]] == [0, 1, 4]
    costs = [float(state.cost) for state in states]
    assert costs == sorted(costs, reverse=True)
    np.testing.assert_allclose(costs[0] - costs[1], states[1].improvement, rtol=1e-9)


@pytest.mark.parametrize("ls_iterations", [4, 50])
def test_every_line_search_length_descends(x64, random_case, solve_tight, ls_iterations):
    args = random_case(2)
    before = solve_tight(*args, iterations=0).status.cost
    after = solve_tight(*args, iterations=1, ls_iterations=ls_iterations).status
    assert after.cost < before


def test_the_tolerance_stops_the_loop(x64, random_case, solve_tight):
    args = random_case(2)
    loose = solve_tight(*args, tolerance=1e-1)
    tight = solve_tight(*args, tolerance=1e-8)
    assert 0 < loose.status.iterations < tight.status.iterations
    again = solve_tight(*args, tight.x, tolerance=1e-8)
    assert again.status.iterations == 0
    np.testing.assert_array_equal(again.x, tight.x)


def test_where_the_search_starts(x64, random_case, solve_tight):
    args = random_case(2)
    good = solve_tight(*args).x
    np.testing.assert_array_equal(solve_tight(*args, good, iterations=0).x, good)
    broken = good.at[1].set(jnp.nan)
    np.testing.assert_array_equal(solve_tight(*args, broken, iterations=0).x, 0)
    for start in (good + 1e3, broken):
        np.testing.assert_allclose(solve_tight(*args, start).x, good, atol=1e-10)


def test_vmap_is_the_solver_of_every_lane(x64, random_case, solve_tight):
    cases = [random_case(seed) for seed in range(3)]
    batch = jax.tree.map(lambda *a: jnp.stack(a), *cases)
    together = jax.jit(jax.vmap(solve_tight))(*batch)
    for i, case in enumerate(cases):
        alone = solve_tight(*case)
        np.testing.assert_allclose(together.x[i], alone.x, atol=1e-12)
    # How many steps gain only rounding depends on the processor, how many lead there does not.
    to_tolerance = functools.partial(solve_tight, tolerance=1e-8)
    together = jax.jit(jax.vmap(to_tolerance))(*batch)
    alone = [to_tolerance(*case).status.iterations for case in cases]
    np.testing.assert_array_equal(together.status.iterations, alone)


@pytest.mark.parametrize("iterations", [1, 100])
def test_a_step_that_is_not_finite_is_refused(x64, random_case, solve_tight, iterations):
    problem, operator, force = random_case(0)
    broken = operator.replace(mass=-operator.mass - 1e3 * jnp.eye(len(force)))
    solution = solve_tight(problem, broken, force, iterations=iterations)
    np.testing.assert_array_equal(solution.x, 0)
    assert not solution.status.finite
    assert solution.status.iterations == 0


@pytest.mark.parametrize("nv", [0, 1])
def test_smallest_problems(random_case, solve_tight, nv):
    problem, operator, force = random_case(0, nv)
    solution = solve_tight(problem, operator, force)
    assert solution.x.shape == (nv,)
    assert np.isfinite(solution.status.cost)


@pytest.mark.parametrize("iterations", [1, 4])
def test_without_rows_the_answer_is_smooth(x64, random_case, solve_tight, iterations):
    _, operator, force = random_case(0)
    empty = Unilateral(jnp.zeros(0), jnp.zeros(0)), (jnp.zeros((0, len(force))),)
    for blocks, jacobian in (((), ()), ((empty[0],), empty[1])):
        bare = DenseOperator(operator.mass, jacobian)
        solution = solve_tight(Problem(blocks), bare, force, iterations=iterations)
        np.testing.assert_allclose(operator.mass @ solution.x, force, atol=1e-12)


def test_padding_changes_nothing(x64, random_case, solve_tight):
    """Rows with D = 0 leave solution and status as they are, whatever their Jacobian."""
    problem, operator, force = random_case(3)

    more = jax.tree.map(lambda a: np.concatenate([a, np.zeros_like(a)]), problem)
    rows = tuple(np.concatenate([J, np.asarray(J) + 1]) for J in operator.jacobian)
    plain = solve_tight(problem, operator, force)
    with_padding = solve_tight(more, DenseOperator(operator.mass, rows), force)
    np.testing.assert_allclose(with_padding.x, plain.x, atol=1e-13)
    assert with_padding.status.iterations == plain.status.iterations


def test_all_rows_inactive(x64, random_case, solve_tight):
    problem, operator, force = random_case(0)
    off = jax.tree.map(jnp.zeros_like, problem)
    solution = solve_tight(off, operator, force)
    np.testing.assert_allclose(operator.mass @ solution.x, force, atol=1e-12)
    assert solution.status.iterations == 1


@pytest.mark.parametrize(("iterations", "left"), [(1, 1e-3), (3, 1e-6)])
def test_the_loop_begins_where_it_costs_less(x64, random_case, solve_tight, iterations, left):
    """At the given point or at the unconstrained one, as in MuJoCo."""
    problem, operator, force = random_case(2)
    smooth = operator.vector(operator.unconstrained(force))
    good = solve_tight(problem, operator, force).x
    end = lambda x: solve_tight(problem, operator, force, x, iterations=iterations).x  # noqa: E731
    np.testing.assert_allclose(end(good + 1e3), end(smooth), rtol=1e-12)
    np.testing.assert_allclose(end(good), good, atol=1e-10)
    assert np.abs(end(smooth) - good).max() > left


@struct.dataclass
class Spoilt(DenseOperator):
    """Solves that are off by a factor, as rounding may make those of a stiff Hessian."""

    factor: Float[Array, ""] | float = 1.0

    def solve(self, curvatures, r):
        """`factor` times the right step."""
        y, status = DenseOperator.solve(self, curvatures, r)
        return jax.tree.map(lambda a: self.factor * a, y), status


def test_a_step_that_rounding_has_spoilt_does_not_end_the_solve(x64, random_case, solve_tight):
    problem, operator, force = random_case(0)
    off = jax.tree.map(jnp.zeros_like, problem)  # Nothing changes zone along any step.
    short = Spoilt(operator.mass, operator.jacobian, 0.7)
    solution = solve_tight(off, short, force)
    assert solution.status.converged
    np.testing.assert_allclose(operator.mass @ solution.x, force, atol=1e-10)


def test_a_line_search_that_finds_nothing_is_not_convergence(x64, random_case, solve_tight):
    problem, operator, force = random_case(0)
    uphill = Spoilt(operator.mass, operator.jacobian, -1.0)
    away = solve_tight(problem, operator, force).x + 1
    stuck = solve_tight(problem, uphill, force, away).status
    assert stuck.iterations == 0
    assert stuck.finite
    assert not stuck.converged
    assert solve_tight(problem, operator, force, away).status.converged
