"""The tasks pendulum, cartpole and acrobot: rewards by hand, starts, and Gymnasium's Pendulum."""

from importlib import resources

import gymnasium
import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

from jaxsim.envs import make, start_from
from jaxsim.envs.base.measures import distance, near_zero, wrapped


@pytest.mark.usefixtures("x64")
def test_pendulum_is_gymnasiums():
    env = make("pendulum").unwrapped
    theirs = gymnasium.make("Pendulum-v1").unwrapped
    theirs.reset(seed=0)
    state = env.reset_to(start_from(env.model, theirs.state[:1], theirs.state[1:]))
    step, rng = quick_jit(env.step), np.random.default_rng(0)
    for action in rng.uniform(-3, 3, (200, 1)):
        obs, reward, *_ = theirs.step(action)
        state = step(state, jnp.asarray(action))
        if abs(state.obs[2]) > 8:  # Gymnasium's limit
            break
        np.testing.assert_allclose(state.reward, reward, rtol=1e-9)
        np.testing.assert_allclose(state.obs, obs, rtol=1e-5, atol=1e-6)  # theirs are float32
    assert state.state.time > 1


@pytest.mark.parametrize(
    ("qpos", "qvel", "action", "expected"),
    [
        ((0.0, 0.0), (0.0, 0.0), 0.0, 1.0),
        ((0.0, np.pi), (0.0, 0.0), 0.0, 0.0),
        ((0.0, 0.0), (0.0, 0.0), 1.0, 0.8),
        ((2.0, 0.0), (0.0, 0.0), 0.0, 0.55),
        ((0.0, np.pi / 2), (0.0, 5.0), 3.0, 0.5 * 0.8 * 0.55),
    ],
)
def test_cartpole_reward_by_hand(qpos, qvel, action, expected):
    env = make("cartpole").unwrapped
    now = start_from(env.model, np.array(qpos), np.array(qvel))
    reward, terms = env.reward({}, now, jnp.array([action]))
    assert reward == pytest.approx(expected, abs=1e-6)
    assert set(terms) == {"upright", "centered", "small_control", "small_velocity"}


@pytest.mark.parametrize(
    ("qpos", "expected"),
    [((0, 0), 1), ((0.1, 0), 1), ((np.pi, 0), 0.1 ** (3.8**2)), ((0, np.pi), 0.1 ** (1.8**2))],
)
def test_acrobot_reward_by_hand(qpos, expected):
    env = make("acrobot").unwrapped
    now = start_from(env.model, np.array(qpos), np.zeros(2))
    assert env.reward({}, now, jnp.zeros(1))[0] == pytest.approx(expected, rel=1e-4)


def test_acrobot_target_is_where_the_tip_can_be():
    mj = mujoco.MjModel.from_xml_path(str(resources.files("jaxsim") / "assets/acrobot.xml"))
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    np.testing.assert_allclose(data.site("tip").xpos, data.site("target").xpos, atol=1e-12)
    assert mj.site("target").size[0] == 0.2


def test_starts(key):
    keys = jax.random.split(key, 2000)

    def of(name):
        return quick_jit(jax.vmap(make(name).reset))(keys).state

    cartpole, pendulum, reacher = of("cartpole"), of("pendulum"), of("reacher")
    np.testing.assert_allclose(cartpole.qpos.mean(0), [0, np.pi], atol=1e-3)
    np.testing.assert_allclose(cartpole.qvel.std(0), 0.01, rtol=0.1)
    assert np.abs(pendulum.qpos).max() <= np.pi
    np.testing.assert_allclose(pendulum.qvel.std(), 1 / np.sqrt(3), rtol=0.1)
    radius = np.linalg.norm(reacher.qpos[:, 2:], axis=1)
    assert radius.max() < 0.2
    np.testing.assert_allclose((radius < 0.1).mean(), 0.25, atol=0.03)  # uniform in the disc
    np.testing.assert_array_equal(reacher.qvel[:, 2:], 0)


def test_measures():
    assert near_zero(jnp.zeros(()), 2) == 1
    assert near_zero(jnp.array(2.0), 2) == pytest.approx(0.1)
    np.testing.assert_allclose(
        wrapped(jnp.array([0.0, 3.5, -3.5, 7.0])),
        [0, 3.5 - 2 * np.pi, 2 * np.pi - 3.5, 7 - 2 * np.pi],
        rtol=1e-5,
    )
    value, slope = jax.value_and_grad(distance)(jnp.zeros(3))
    assert value == 0
    np.testing.assert_array_equal(slope, 0)
    np.testing.assert_allclose(jax.grad(distance)(jnp.array([3.0, 4.0])), [0.6, 0.8], rtol=1e-6)


@pytest.mark.usefixtures("x64")
def test_return_of_a_rollout_has_a_derivative(key):
    env = make("pendulum")

    def total(force):
        def step(state, _):
            state = env.step(state, force[None])
            return state, state.reward

        return jax.lax.scan(step, env.reset(key), length=8)[1].sum()

    h, run = 1e-5, quick_jit(total)
    slope = quick_jit(jax.grad(total))(0.3)
    np.testing.assert_allclose(slope, (run(0.3 + h) - run(0.3 - h)) / (2 * h), rtol=1e-7)
