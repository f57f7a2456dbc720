"""Problems that make no sense are refused before anything is compiled."""

import jax.numpy as jnp
import pytest

import jaxsim
from jaxsim import trajopt

VALID = {
    "dynamics": lambda x, u: x + u.sum(),
    "start": jnp.zeros(3),
    "horizon": 5,
    "running_cost": lambda x, u, t: x @ x,
    "nu": 2,
}


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"horizon": 0}, "horizon must be a positive integer, got 0"),
        ({"horizon": 2.5}, "horizon must be a positive integer"),
        ({"frame_skip": 0}, "frame_skip must be a positive integer"),
        (
            {"running_cost": lambda x, u, t: x},
            r"running_cost must .* got float32\[3\]",
        ),
        ({"running_cost": lambda x, u, t: (x @ x, 0.0)}, "running_cost must return a number"),
        ({"running_cost": lambda x, u, t: None}, "running_cost must return a number"),
        ({"final_cost": lambda x: x[:1]}, r"final_cost must return a number, got float32\[1\]"),
        ({"dynamics": lambda x, u: x[:2]}, r"like start, float32\[3\], got float32\[2\]"),
        ({"dynamics": 3}, "must be a jaxsim.Model or a function"),
        ({"start": None}, "need a start"),
        ({"nu": None}, "need nu or control_limits"),
        ({"control_limits": (jnp.zeros(3), 1.0)}, r"must be a number or have shape \(2,\)"),
        ({"control_limits": (1.0, 0.0)}, "low above high"),
        ({"control_limits": (0.0, 1.0, 2.0)}, "must be a pair"),
    ],
)
def test_bad_problems(changes, message):
    arguments = VALID | changes
    with pytest.raises(trajopt.ProblemError, match=message) as caught:
        trajopt.make_problem(arguments.pop("dynamics"), **arguments)
    assert isinstance(caught.value, jaxsim.JaxsimError)
    assert isinstance(caught.value, ValueError)


def test_a_guess_of_the_wrong_shape_and_no_iterations():
    dynamics = VALID["dynamics"]
    problem = trajopt.make_problem(dynamics, **{k: VALID[k] for k in VALID if k != "dynamics"})
    with pytest.raises(trajopt.ProblemError, match=r"ctrls must have shape \(5, 2\), got \(5, 1\)"):
        trajopt.solve(problem, trajopt.ILQR(), jnp.zeros((5, 1)))
    with pytest.raises(trajopt.ProblemError, match="iterations must be at least 1, got 0"):
        trajopt.solve(problem, trajopt.ILQR(iterations=0))


def test_bad_states_of_a_model():
    model = jaxsim.load("pendulum")
    cost = {"horizon": 5, "running_cost": lambda x, u, t: 0.0}
    with pytest.raises(trajopt.ProblemError, match=r"must be a jaxsim.State .* got ArrayImpl"):
        trajopt.make_problem(model, jnp.zeros(2), **cost)
    state = jaxsim.make_state(model)
    with pytest.raises(trajopt.ProblemError, match=r"shape \(1,\), got \(4, 1\)"):
        trajopt.make_problem(model, state.replace(qpos=jnp.zeros((4, 1))), **cost)
    with pytest.raises(trajopt.ProblemError, match="no actuators"):
        trajopt.make_problem(jaxsim.load("box_on_plane"), **cost)


def test_limits_are_the_models():
    problem = trajopt.make_problem(
        jaxsim.load("pendulum"), horizon=5, running_cost=lambda x, u, t: 0.0
    )
    assert (problem.low, problem.high) == (-2, 2)
