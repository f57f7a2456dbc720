"""The adapter with Brax's shapes: the contract of `brax.envs`, and PPO of Brax running on it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.sharding import Mesh, NamedSharding, PartitionSpec

import jaxsim.envs
from jaxsim.envs.bridges.brax_env import BraxEnv, wrap_for_brax


@pytest.fixture
def env():
    return BraxEnv("fast")


def test_has_the_properties_of_a_brax_environment(env):
    assert (env.observation_size, env.action_size, env.backend) == (1, 1, "jaxsim")
    assert env.unwrapped is env
    assert float(env.dt) == pytest.approx(0.1)


def test_reset_and_step_are_those_of_the_environment(env):
    inner = jaxsim.envs.make("fast", max_episode_steps=None)
    action = jnp.full(1, 0.5)
    state, expected = env.reset(jax.random.PRNGKey(3)), inner.reset(jax.random.PRNGKey(3))
    np.testing.assert_array_equal(state.obs, expected.obs)
    state, expected = env.step(state, action), inner.step(expected, action)
    np.testing.assert_array_equal(state.obs, expected.obs)
    assert state.reward == expected.reward
    assert set(state.metrics) == {"distance", "nonfinite"}


def test_keys_of_both_kinds_do(env):
    np.testing.assert_array_equal(
        env.reset(jax.random.key(3)).obs, env.reset(jax.random.PRNGKey(3)).obs
    )


def test_done_and_truncation_are_numbers(env):
    limited = BraxEnv(jaxsim.envs.make("fast", max_episode_steps=1))
    state = limited.step(limited.reset(jax.random.key(0)), jnp.zeros(1))
    assert (state.done, state.info["truncation"]) == (1.0, 1.0)
    state = env.reset(jax.random.key(0))
    assert (state.done, state.info["truncation"]) == (0.0, 0.0)
    for _ in range(40):
        state = env.step(state, jnp.ones(1))
    assert (state.done, state.info["truncation"]) == (1.0, 0.0)
    assert state.done.dtype == state.reward.dtype


def test_reset_and_step_have_one_structure_and_keep_what_wrappers_add(env):
    first = env.reset(jax.random.key(0))
    first = first.replace(
        info={**first.info, "first_obs": first.obs}, metrics={**first.metrics, "reward": 0.0}
    )
    second = env.step(first, jnp.zeros(1))
    assert jax.tree.structure(first) == jax.tree.structure(second)
    assert second.info["first_obs"] is first.obs


def test_the_model_can_be_replaced_as_brax_does(env):
    model = env.sys
    env.sys = model.replace(opt=model.opt.replace(timestep=jnp.asarray(0.2)))
    state = env.reset(jax.random.key(0))
    moved = env.step(state, jnp.ones(1)).obs - state.obs
    np.testing.assert_allclose(moved, 0.2, rtol=1e-6)


def _randomised(model, count):
    timestep = jnp.linspace(0.1, 0.4, count)
    models = model.replace(opt=model.opt.replace(timestep=timestep))
    axes = jax.tree.map(lambda _: None, model)
    return models, axes.replace(opt=axes.opt.replace(timestep=0))


@pytest.mark.filterwarnings("ignore")
def test_batch_of_brax_wrappers_is_that_of_brax_itself(env):
    """Cut after three steps, restarted at the first state: the same numbers either way."""
    training = pytest.importorskip("brax.envs.wrappers.training")
    keys = jax.random.split(jax.random.PRNGKey(0), 3)
    batches = [wrap(env, episode_length=3) for wrap in (wrap_for_brax, training.wrap)]
    ours, theirs = (batch.reset(keys) for batch in batches)
    for _ in range(4):
        ours, theirs = (
            batch.step(state, jnp.full((3, 1), 0.3))
            for batch, state in zip(batches, (ours, theirs), strict=True)
        )
        jax.tree.map(lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-6), ours, theirs)
    assert batches[0].observation_size == 1


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("repeat", [1, 2])
def test_a_limit_of_the_environment_is_a_cut_and_no_termination(repeat):
    """Brax bootstraps the value there. Its own wrappers know only of their own count."""
    training = pytest.importorskip("brax.envs.wrappers.training")
    env = BraxEnv(jaxsim.envs.make("fast", max_episode_steps=4))
    for wrap, steps in ((wrap_for_brax, 4), (training.wrap, 6)):
        batch = wrap(env, episode_length=6, action_repeat=repeat)
        state = batch.reset(jax.random.split(jax.random.PRNGKey(0), 2))
        for count in range(1, 1 + steps // repeat):
            state = batch.step(state, jnp.zeros((2, 1)))
            ended = count == steps // repeat
            np.testing.assert_array_equal(state.done, ended)
            np.testing.assert_array_equal(state.info["truncation"], ended)
        np.testing.assert_array_equal(state.obs, state.info["first_obs"])


@pytest.mark.filterwarnings("ignore")
def test_the_end_of_a_task_is_a_termination():
    pytest.importorskip("brax.envs.wrappers.training")
    batch = wrap_for_brax(BraxEnv(jaxsim.envs.make("fast", max_episode_steps=100)), 100)
    state = batch.reset(jax.random.split(jax.random.PRNGKey(0), 2))
    while not state.done.any():
        state = batch.step(state, jnp.ones((2, 1)))
    np.testing.assert_array_equal(state.info["truncation"], 0)


def test_what_diverges_ends_the_episode_and_goes_nowhere(env):
    start = env.reset(jax.random.key(0))
    after = env.step(start, jnp.array([jnp.nan]))
    assert (after.done, after.reward, after.metrics["nonfinite"]) == (1, 0, 1)
    np.testing.assert_array_equal(after.obs, start.obs)


@pytest.mark.filterwarnings("ignore")
def test_models_can_differ_in_a_batch(env):
    pytest.importorskip("brax.envs.wrappers.training")
    batch = wrap_for_brax(env, randomization_fn=lambda model: _randomised(model, 4))
    state = batch.reset(jax.random.split(jax.random.PRNGKey(0), 4))
    moved = batch.step(state, jnp.ones((4, 1))).obs - state.obs
    np.testing.assert_allclose(moved[:, 0], [0.1, 0.2, 0.3, 0.4], rtol=1e-5)


def _replicated(tree, devices):
    split = NamedSharding(Mesh(devices, ("device",)), PartitionSpec("device"))
    return jax.tree.map(lambda x: jax.device_put(jnp.stack([x] * len(devices)), split), tree)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("wrap", [None, wrap_for_brax], ids=["brax", "ours"])
def test_brax_ppo_trains(env, wrap, monkeypatch):
    ppo = pytest.importorskip("brax.training.agents.ppo.train")
    # Brax still calls a function that JAX has removed.
    monkeypatch.setattr(jax, "device_put_replicated", _replicated, raising=False)
    returns = []
    with jax.numpy_rank_promotion("allow"):
        ppo.train(
            env,
            num_timesteps=4000,
            episode_length=20,
            num_envs=16,
            batch_size=16,
            num_minibatches=4,
            unroll_length=5,
            num_updates_per_batch=4,
            learning_rate=1e-2,
            num_eval_envs=16,
            num_evals=2,
            wrap_env_fn=wrap,
            progress_fn=lambda _, metrics: returns.append(metrics["eval/episode_reward"]),
        )
    assert len(returns) == 2
    assert np.isfinite(returns).all()
    assert returns[1] > returns[0]
