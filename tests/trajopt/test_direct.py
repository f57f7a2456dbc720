"""Contact forces as unknowns: an optimum in closed form, boxes at their goals, clear errors."""

import contact_scenes as scenes
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim import trajopt
from jaxsim.trajopt.tasks import TASKS

HORIZON, EFFORT, WORTH = 8, 0.5, 20.0


def bulldozer(gap, mobility=1.0):
    """A blade and, `gap` ahead of it, a box on which forces have effect times `mobility`."""

    def step(x, w):
        return x + jnp.stack([w[0], mobility * w[1]])

    return trajopt.make_problem(
        step,
        jnp.stack([jnp.zeros_like(gap), gap]),
        horizon=HORIZON,
        running_cost=lambda x, w, t: EFFORT * w[0] ** 2,
        final_cost=lambda x: WORTH * (x[1] - 1) ** 2,
        nu=2,
        complementarity=lambda x, w, y: (w[1:], y[1:] - y[:1]),
    )


def test_64_starts_and_models_at_once_have_their_exact_optimum(x64):
    """The blade moves with constant speed, U in all, where U minimises
    `EFFORT U^2 / T + WORTH (U - 1)^2`; boxes that are ahead are pushed, whatever they weigh."""
    gaps, mobilities = jnp.linspace(0.05, 0.6, 64), jnp.tile(jnp.array([0.5, 2.0]), 32)

    @quick_jit
    @jax.vmap
    def plans(gap, mobility):
        problem = bulldozer(gap, mobility)
        plan = trajopt.solve(problem, trajopt.Direct(tolerance=1e-7), jnp.zeros((HORIZON, 2)))
        return plan, problem.rollout(plan.ctrls)[0]

    plan, replay = plans(gaps, mobilities)
    assert (plan.status == trajopt.PlanStatus.CONVERGED).all()
    travel = WORTH / (WORTH + EFFORT / HORIZON)
    np.testing.assert_allclose(plan.states[:, -1], travel, atol=1e-3)
    np.testing.assert_allclose(plan.ctrls[:, :, 0], travel / HORIZON, atol=1e-2)
    np.testing.assert_allclose(replay, plan.states, atol=1e-6)
    force, distance = plan.ctrls[:, :, 1], plan.states[:, 1:, 1] - plan.states[:, 1:, 0]
    assert np.abs(force * distance).max() <= 1e-6
    assert min(force.min(), distance.min()) >= -1e-6


def test_plans_are_made_anew_from_the_last_one(x64):
    """Two iterations for each control, while the box is heavier than in the plan."""
    problem, plant = bulldozer(jnp.array(0.3)), bulldozer(jnp.array(0.3), 0.5).step
    track = quick_jit(
        lambda w: trajopt.mpc(
            problem, trajopt.Direct(), 48, w, iterations=2, first_iterations=100, plant=plant
        )
    )(jnp.zeros((HORIZON, 2)))
    blade, box = track.states.T
    np.testing.assert_allclose(box[-1], 1, atol=0.03)
    assert (np.diff(box) > -1e-4).all(), "nothing pulls"
    far = box - blade > 0.05
    assert np.abs(np.diff(box)[far[:-1] & far[1:]]).max() < 1e-3, "what is not touched rests"


@pytest.mark.slow
def test_a_box_is_pushed_to_18_goals(x64):
    """3 m off, turned by up to 360 degrees, from controls that are zero; all at once."""
    angle = jnp.arange(1, 19) * 2 * jnp.pi / 18
    goals = jnp.stack([3 * jnp.cos(angle), 3 * jnp.sin(angle), angle], axis=1)

    @quick_jit
    @jax.vmap
    def plans(goal):
        problem = scenes.sliding_box(goal)
        plan = trajopt.solve(problem, trajopt.Direct(iterations=200), jnp.zeros((100, 6)))
        return plan, problem.rollout(plan.ctrls)[0]

    plan, replay = plans(goals)
    assert (plan.status == trajopt.PlanStatus.CONVERGED).all()
    assert plan.defect.max() <= 1e-6
    np.testing.assert_allclose(plan.states[:, -1], goals, atol=0.03)
    np.testing.assert_allclose(replay, plan.states, atol=1e-6)


PUSH_TO = jnp.array([0.3, 0.1, 0.3])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("problem", "coordinates", "goal"),
    [
        (TASKS["spin"].make, np.array([2]), jnp.array([2.0])),
        (lambda: scenes.push(jaxsim.load(scenes.PUSHER), PUSH_TO), np.arange(3), PUSH_TO),
    ],
)
def test_models_find_contacts_with_rigid_forces(x64, problem, coordinates, goal):
    """A finger turns a wheel and pushes a box that it does not touch; plans follow their forces."""
    forced = trajopt.with_contact_forces(problem())

    @quick_jit
    def solved(w):
        plan = trajopt.solve(forced, trajopt.Direct(), w)
        before = jax.tree.map(lambda x: x[:-1], plan.states)
        normal = jax.vmap(forced.normal_forces)(before, plan.ctrls)
        return plan, forced.rollout(plan.ctrls)[0].qpos, normal

    plan, replay, normal = solved(jnp.zeros((forced.horizon, forced.low.size)))
    assert plan.status == trajopt.PlanStatus.CONVERGED
    assert plan.defect <= 1e-6
    np.testing.assert_allclose(plan.states.qpos[-1, coordinates], goal, atol=0.02)
    np.testing.assert_allclose(replay, plan.states.qpos, atol=1e-5)
    assert normal.shape == (forced.horizon, 1)
    assert normal.min() > -1e-6
    assert normal.max() > 0.1


@pytest.mark.parametrize(
    ("pairs", "found"),
    [
        (lambda x, w, y: x, r"got float32\[2\]"),
        (lambda x, w, y: (x, w[:1]), r"float32\[2\], float32\[1\]"),
        (lambda x, w, y: (x[0], x[1]), "float32"),
    ],
)
def test_complementarity_is_a_pair_of_arrays(pairs, found):
    with pytest.raises(trajopt.ProblemError, match=f"pair of arrays.*{found}"):
        trajopt.make_problem(
            lambda x, w: x,
            jnp.zeros(2),
            horizon=3,
            running_cost=lambda x, w, t: 0.0,
            nu=2,
            complementarity=pairs,
        )


def test_what_does_not_fit_is_an_error():
    problem = bulldozer(jnp.array(0.1))
    with pytest.raises(trajopt.ProblemError, match="use Direct"):
        trajopt.solve(problem, trajopt.ILQR())
    with pytest.raises(trajopt.ProblemError, match="use Direct"):
        trajopt.mpc(problem, trajopt.ILQR(), 3)
    with pytest.raises(trajopt.ProblemError, match="at least 1, got 0 and 1"):
        trajopt.mpc(problem, trajopt.Direct(), 0)
    with pytest.raises(trajopt.ProblemError, match=r"states must have shape \(9, 2\)"):
        trajopt.solve(problem, trajopt.Direct(states=jnp.zeros((3, 2))))
    with pytest.raises(trajopt.ProblemError, match="needs a jaxsim.Model"):
        trajopt.with_contact_forces(problem)
    alone = jaxsim.load("pendulum")
    lonely = trajopt.make_problem(alone, horizon=3, running_cost=lambda x, u, t: u @ u)
    with pytest.raises(trajopt.ProblemError, match="a model with contacts"):
        trajopt.with_contact_forces(lonely)
