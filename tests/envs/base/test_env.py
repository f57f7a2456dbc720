"""Environments as such: pure, batched, registered by name, written in a few lines."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import struct
from oracle import quick_jit

import jaxsim
from jaxsim.envs import Task, make, register, static, uniform_start
from jaxsim.envs.base.start import load_asset
from jaxsim.model import Model

CHEAP = ("fast", "pendulum", "cartpole", "acrobot")
MEDIUM = ("inverted_pendulum", "inverted_double_pendulum", "reacher", "swimmer")


@struct.dataclass(kw_only=True)
class Balance(Task):
    """A task as a user would write it, with a goal."""

    model: Model = struct.field(default_factory=lambda: load_asset("pendulum"))
    frame_skip: int = static(2)
    noise: float = 0.01

    def start(self, key):
        return uniform_start(self.model, key, self.noise)

    def draw(self, key):
        return {"goal": jax.random.uniform(key)}

    def observe(self, now):
        return jnp.concatenate([now.qpos, now.qvel, now.before["goal"][None]])

    def reward(self, before, now, action):
        away = now.qpos[0] - before["goal"]
        return 1 - away**2, {"away": away}

    def terminated(self, now):
        return jnp.abs(now.qpos[0]) > 1

    def control(self, action):
        return 2 * action


def _batch(env, key, n=3):
    states = jax.jit(jaxsim.vmap(env.reset))(jax.random.split(key, n))
    return states, jnp.linspace(-1, 1, n * env.action_size).reshape(n, -1)


@pytest.mark.parametrize("name", CHEAP)
def test_a_batch_is_many_environments(name, key):
    env = make(name)
    states, actions = _batch(env, key)
    after = quick_jit(jaxsim.vmap(env.step))(states, actions)
    singly = quick_jit(jax.vmap(env.step))(states, actions)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-5), after, singly)
    for i, one in enumerate(jax.random.split(key, 3)):
        obs = env.reset(one).obs
        np.testing.assert_allclose(states.obs[i], obs, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("name", CHEAP + MEDIUM)
def test_reset_and_step_have_the_same_structure(name):
    env = make(name)
    start = jax.eval_shape(env.reset, jax.random.key(0))
    action = jax.ShapeDtypeStruct((env.action_size,), start.obs.dtype)
    after = jax.eval_shape(env.step, start, action)
    assert jax.tree.structure(start) == jax.tree.structure(after)
    assert jax.tree.leaves(start) == jax.tree.leaves(after)
    assert start.obs.shape == (env.observation_size,)
    assert start.reward.shape == start.terminated.shape == start.truncated.shape == ()
    assert env.action_low.shape == env.action_high.shape == (env.action_size,)
    assert np.all(env.action_low < env.action_high)
    assert float(env.dt) == pytest.approx(float(env.model.opt.timestep) * env.frame_skip)


def test_an_environment_is_data(key):
    env = make("pendulum")
    heavy = env.with_model(env.model.replace(body_mass=2 * env.model.body_mass))
    step = quick_jit(lambda env, key: env.step(env.reset(key), jnp.ones(1)))
    light, heavy = (step(e, key).state.qvel[0] for e in (env, heavy))
    assert light != heavy
    assert env.model.body_mass[1] == 1


def test_a_task_of_ones_own(key):
    register("balance-test", Balance, max_episode_steps=5)
    register("balance-test", Balance, max_episode_steps=3)  # again, with other settings
    env = make("balance-test", noise=0.2)
    assert env.unwrapped.noise == 0.2
    state, step = env.reset(key), quick_jit(env.step)
    goal = state.info["goal"]
    for i in range(3):
        state = step(state, jnp.ones(1))
        assert bool(state.truncated) == (i == 2)
        assert state.info["goal"] == goal == state.obs[2]
        assert state.metrics["away"] == state.obs[0] - goal


def test_the_time_limit_can_be_changed(key):
    assert make("fast").max_episode_steps == 20
    assert make("fast", max_episode_steps=7).max_episode_steps == 7
    assert isinstance(make("fast", max_episode_steps=None), type(make("fast").unwrapped))
    assert make("reacher", reward_control_weight=0.1).unwrapped.reward_control_weight == 0.1


def test_errors_name_what_would_work():
    with pytest.raises(KeyError, match="did you mean reacher"):
        make("reecher")
    with pytest.raises(TypeError, match="did you mean reset_noise_scale"):
        make("swimmer", reset_noise=0.2)
    with pytest.raises(ValueError, match="positive whole number"):
        make("fast", max_episode_steps=0)
    with pytest.raises(TypeError, match="derives from jaxsim.envs.Task"):
        register("no-task", dict)
    with pytest.raises(TypeError, match="struct.dataclass"):
        register("no-record", type("NoRecord", (Task,), {}))
    with pytest.raises(ValueError, match="already"):
        register("fast", Balance)
    with pytest.raises(TypeError, match="does not define start"):
        Task(model=load_asset("pendulum")).reset(jax.random.key(0))


def test_all_registered_names_resolve():
    assert {*CHEAP, *MEDIUM} <= set(jaxsim.envs.names())
    for name in (*CHEAP, *MEDIUM):
        assert issubclass(jaxsim.envs.spec(name).load(), jaxsim.envs.Env)


def test_a_file_in_the_working_directory_is_no_task(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fast").write_text("<mujoco/>")
    assert load_asset("fast", hessian="dense").nv > 0  # an argument of its own: not yet loaded


@struct.dataclass(kw_only=True)
class Two(Balance):
    """Two balls that touch the floor, and one slot for their contacts."""

    def start(self, key):
        return jaxsim.make_state(self.model)


def test_a_step_tells_how_its_solves_went(key):
    ball = '<body pos="{} 0 .0999"><joint type="slide" axis="0 0 1"/><geom size=".1"/></body>'
    model = jaxsim.load(
        f"""<mujoco><worldbody><geom type="plane" size="1 1 1"/>{ball.format(0)}{ball.format(1)}
        </worldbody></mujoco>""",
        max_contacts=1,
    )
    env = Two(model=model)
    first = env.reset(key)
    assert (first.solves.lost_contacts, first.solves.unconverged) == (0, False)
    after = quick_jit(env.step)(first, jnp.zeros(0))
    assert (after.solves.lost_contacts, after.solves.unconverged) == (1, False)
    hasty = env.with_model(model.replace(opt=model.opt.replace(iterations=0)))
    assert quick_jit(hasty.step)(first, jnp.zeros(0)).solves.unconverged
