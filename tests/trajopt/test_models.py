"""Plans for models: a swing-up, feedback, and states with quaternions."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim import trajopt
from jaxsim.trajopt.space import StateSpace

BALL = """
<mujoco>
  <worldbody>
    <body name="free"><freejoint/><geom size="0.1"/></body>
    <body name="ball"><joint type="ball"/><geom size="0.1"/>
      <body><joint name="hinge"/><geom size="0.1"/></body>
    </body>
  </worldbody>
  <actuator><general joint="hinge" dyntype="integrator"/></actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def pendulum():
    """The rod from hanging to upright, with a motor that holds it up at 24 degrees at most."""
    model = jaxsim.load("pendulum")
    return trajopt.make_problem(
        model,
        jaxsim.make_state(model).replace(qpos=jnp.array([jnp.pi])),
        horizon=60,
        running_cost=lambda x, u, t: 0.1 * (1 - jnp.cos(x.qpos[0])) + 1e-3 * u @ u,
        final_cost=lambda x: 20 * (1 - jnp.cos(x.qpos[0])) + x.qvel @ x.qvel,
    )


@pytest.fixture(scope="module")
def swing_up(pendulum):
    return trajopt.solve(pendulum, trajopt.ILQR(), key=jax.random.key(1))


def test_pendulum_swings_up_and_stands(pendulum, swing_up):
    assert swing_up.status == trajopt.PlanStatus.CONVERGED
    last = jax.tree.map(lambda x: x[-1], swing_up.states)
    assert np.cos(last.qpos[0]) > 0.99
    assert abs(last.qvel[0]) < 0.1
    assert np.all(np.abs(swing_up.ctrls) <= 2)
    assert np.sum(np.abs(swing_up.ctrls) == 2) > 10, "the motor is at its limits for some time"
    assert np.all(np.diff(swing_up.history[: int(swing_up.iterations)]) <= 0)
    assert np.isnan(swing_up.history[int(swing_up.iterations) :]).all()


def test_gains_bring_a_disturbed_motion_back(pendulum, swing_up):
    start = pendulum.start.replace(qpos=pendulum.start.qpos + 0.05, qvel=jnp.array([-0.1]))
    problem = pendulum.replace(start=start)
    with_gains = lambda: problem.follow(lambda x, t: swing_up.ctrl(problem, x, t), jnp.arange(60))  # noqa: E731
    without = lambda: problem.follow(lambda x, u: u, swing_up.ctrls)  # noqa: E731
    ends = [states.qpos[-1, 0] for states, _, _ in (quick_jit(f)() for f in (with_gains, without))]
    fed_back, open_loop = np.abs(np.array(ends) - swing_up.states.qpos[-1, 0])
    assert open_loop > 0.3
    assert fed_back < 0.3 * open_loop


def test_tangent_vectors_lead_back(x64, rng):
    model = jaxsim.load(BALL)
    space = StateSpace(model)
    assert space.size == 2 * 10 + 1
    x = jaxsim.make_state(model)

    @quick_jit
    def there_and_back(x, dx):
        y = space.retract(x, dx)
        jacobian = jax.jacfwd(lambda dx: space.difference(x, space.retract(x, dx)))(0 * dx)
        return y.qpos, space.difference(x, y), jacobian

    dx = jnp.asarray(rng.normal(size=space.size))
    qpos, back, jacobian = there_and_back(x, dx)
    np.testing.assert_allclose(np.linalg.norm(qpos[3:7]), 1)
    np.testing.assert_allclose(back, dx, atol=1e-12)
    np.testing.assert_allclose(jacobian, np.eye(space.size), atol=1e-12)
