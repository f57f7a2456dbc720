"""Plans are drawn with what is in them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsim
from jaxsim import trajopt, viz

BALL = """<mujoco><worldbody><light pos="0 0 3"/><geom type="plane" size="1 1 .1"/>
  <body pos="0 0 .1"><joint name="z" type="slide" axis="0 0 1"/><geom size=".1" mass="2"/></body>
  </worldbody><actuator><motor joint="z"/></actuator></mujoco>"""
WEIGHT = 2 * 9.81


def plan_of(states, ctrls):
    """States and controls as a plan."""
    nothing = jnp.zeros(1)
    return trajopt.Plan(ctrls, states, nothing, nothing, nothing, nothing, None, nothing)


def panels(picture):
    """What the panels show by their name: times and numbers of their lines."""
    return {
        axes.get_ylabel(): (
            axes.lines[0].get_xdata(),
            np.stack([x.get_ydata() for x in axes.lines]),
        )
        for axes in picture.axes
    }


@pytest.fixture(scope="module")
def at_rest():
    """A ball on the floor, and a plan in which it sinks a millimetre, then stays for 5 steps."""
    problem = trajopt.make_problem(
        jaxsim.load(BALL), horizon=5, running_cost=lambda x, u, t: jnp.sum(u**2)
    )
    states = jax.tree.map(lambda x: jnp.stack([x] * 6), problem.start)
    height = jnp.full((6, 1), -1e-3).at[0].set(1e-3)
    states = states.replace(qpos=height, time=0.002 * jnp.arange(6))
    return problem, plan_of(states, jnp.full((5, 1), 0.5))


def test_states_controls_and_contact_forces(at_rest):
    problem, plan = at_rest
    shown = panels(viz.plot_plan(problem, plan, "at rest"))
    assert list(shown) == ["position", "velocity", "control", "contact forces (N)"]
    np.testing.assert_allclose(shown["position"][0], plan.states.time)
    np.testing.assert_array_equal(shown["position"][1][0], plan.states.qpos[:, 0])
    np.testing.assert_array_equal(shown["control"][1], 0.5)
    forces = shown["contact forces (N)"][1][0]
    assert forces[0] == 0
    np.testing.assert_allclose(forces[1:], forces[1])
    assert forces[1] > WEIGHT, "what presses it out again"


@pytest.mark.slow
def test_a_film_of_what_the_controls_do(at_rest, tmp_path):
    problem, plan = at_rest
    elsewhere = plan.replace(states=plan.states.replace(qpos=plan.states.qpos + 1))
    options = {"width": 64, "height": 48}
    try:
        files = [
            viz.film_plan(problem, found, tmp_path / f"{i}.gif", **options)
            for i, found in enumerate((plan, elsewhere))
        ]
    except RuntimeError as error:
        pytest.skip(str(error))
    assert files[0].read_bytes() == files[1].read_bytes()


def test_forces_that_are_unknowns_and_products_of_pairs():
    """A blade and a box: a push of 3 N at distances of 0.2 m."""
    problem = trajopt.make_problem(
        lambda x, w: x + w,
        jnp.array([0.0, 0.2]),
        horizon=4,
        running_cost=lambda x, w, t: jnp.sum(w**2),
        nu=2,
        complementarity=lambda x, w, y: (w[1:], x[1:] - x[:1]),
    ).replace(normal_forces=lambda x, w: w[1:])
    ctrls = jnp.full((4, 2), 3.0)
    shown = panels(viz.plot_plan(problem, plan_of(problem.rollout(ctrls)[0], ctrls)))
    assert list(shown) == ["state", "control", "normal forces (N)", "products of pairs"]
    np.testing.assert_array_equal(shown["normal forces (N)"][1], 3)
    np.testing.assert_allclose(shown["products of pairs"][1], 0.6, rtol=1e-6)


def test_dynamics_that_are_a_function(tmp_path):
    problem = trajopt.make_problem(
        lambda x, u: {"a": x["a"] + u},
        {"a": jnp.zeros(2)},
        horizon=3,
        running_cost=lambda x, u, t: jnp.sum(u**2),
        nu=2,
    )
    ctrls = jnp.ones((3, 2))
    plan = plan_of(problem.rollout(ctrls)[0], ctrls)
    shown = panels(viz.plot_plan(problem, plan))
    assert list(shown) == ["state", "control"]
    np.testing.assert_array_equal(shown["state"][1], np.arange(4) * np.ones((2, 1)))
    with pytest.raises(ValueError, match=r"ctrls of shape \(3, 2\), got \(2, 2\)"):
        viz.plot_plan(problem, plan.replace(ctrls=plan.ctrls[:2]))
    with pytest.raises(ValueError, match=r"a jaxsim.Model"):
        viz.film_plan(problem, plan, tmp_path / "none.gif")
