"""Experience is what the environment says, whatever the chunks; episodes are counted."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import struct
from jax.sharding import Mesh, PartitionSpec

from jaxsim import envs
from jaxsim.envs import Wrapper
from jaxsim.envs.base import Solves
from jaxsim.parallel.devices import device_mesh, parallel
from jaxsim.rl.parts import collect as module
from jaxsim.rl.parts.collect import collect, start_actors

STEPS, COUNT = 50, 6


def push(obs, key):
    """Away from the middle, so that some episodes end early and others are cut short."""
    action = jnp.where(obs > 0.3, 1.0, 0.1)
    return action, {"sign": jnp.sign(obs)}


@pytest.fixture
def env():
    return envs.AutoReset(envs.make("fast"))


@pytest.fixture
def keys():
    return jax.random.split(jax.random.key(3), COUNT)


def run(env, keys, lanes, monkeypatch):
    monkeypatch.setattr(module, "even_lanes", lambda model, count: lanes)
    collected = jax.jit(
        lambda keys: collect(env, push, start_actors(env, keys), jax.random.key(0), STEPS)
    )
    return collected(keys)


def by_hand(env, key):
    """One environment, one step at a time."""
    state, rows = jax.jit(env.reset)(key), []
    step = jax.jit(env.step)
    for _ in range(STEPS):
        obs = state.obs
        state = step(state, push(obs, None)[0])
        rows.append((obs, state.reward, state.info["terminal_obs"], state.done))
    return [np.stack(column) for column in zip(*rows, strict=True)]


@pytest.mark.parametrize("lanes", [6, 2])
def test_agrees_with_stepping_by_hand(env, keys, lanes, monkeypatch):
    _, seen, episodes = run(env, keys, lanes, monkeypatch)
    ends = 0
    for i in range(COUNT):
        obs, reward, next_obs, done = by_hand(env, keys[i])
        np.testing.assert_allclose(seen.obs[:, i], obs, atol=1e-6)
        np.testing.assert_allclose(seen.reward[:, i], reward, atol=1e-6)
        np.testing.assert_allclose(seen.next_obs[:, i], next_obs, atol=1e-6)
        np.testing.assert_array_equal((seen.terminated | seen.truncated)[:, i], done)
        ends += done.sum()
    np.testing.assert_array_equal(seen.extras["sign"], jnp.sign(seen.obs))
    assert episodes.count == ends > COUNT
    assert seen.terminated.any()
    assert seen.truncated.any()


def test_next_observation_is_the_next_one_within_an_episode(env, keys, monkeypatch):
    _, seen, _ = run(env, keys, 3, monkeypatch)
    going = ~(seen.terminated | seen.truncated)[:-1]
    np.testing.assert_array_equal(seen.next_obs[:-1][going], seen.obs[1:][going])
    assert (seen.next_obs[:-1][~going] != seen.obs[1:][~going]).all()


def test_sums_over_episodes(env, keys, monkeypatch):
    """Rewards of ended episodes and of unfinished ones are all rewards."""
    actors, seen, episodes = run(env, keys, 2, monkeypatch)
    np.testing.assert_allclose(
        episodes.returns + actors.episode_return.sum(), seen.reward.sum(), rtol=1e-4
    )
    assert episodes.lengths + actors.episode_length.sum() == STEPS * COUNT
    assert episodes.nonfinite == 0


def test_metrics_are_means_over_the_episodes_of_all_devices(env, keys):
    def part(keys):
        return collect(env, push, start_actors(env, keys), jax.random.key(0), STEPS)[2].metrics()

    mesh = device_mesh()
    on_two = parallel(part, mesh, PartitionSpec("batch"), PartitionSpec())(keys)
    one = Mesh(np.array(jax.devices()[:1]), ("batch",))
    on_one = parallel(part, one, PartitionSpec("batch"), PartitionSpec())(keys)
    for name, value in on_one.items():
        np.testing.assert_allclose(on_two[name], value, rtol=1e-5)


@struct.dataclass
class Crowded(Wrapper):
    """Contacts are lost, and solves run out, far to the right."""

    def reset(self, key):
        return self.told(self.env.reset(key))

    def step(self, state, action):
        return self.told(self.env.step(state, action))

    def told(self, state):
        far = state.obs[0] > 0.3
        return state.replace(solves=Solves(jnp.where(far, 7, 0), far))


def test_steps_in_which_solves_went_wrong_are_counted(keys, monkeypatch):
    env = envs.AutoReset(Crowded(envs.make("fast")))
    _, seen, episodes = run(env, keys, 2, monkeypatch)
    far = (seen.next_obs[..., 0] > 0.3).sum()
    assert episodes.lost_contacts == episodes.unconverged == far > 0
