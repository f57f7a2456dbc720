"""The `VecEnv` of Stable-Baselines3, against the rules of its base class (which needs torch)."""

import sys

import gymnasium
import numpy as np
import pytest

import jaxsim.envs  # noqa: F401
from jaxsim.envs.bridges import stable_baselines

# What `stable_baselines3.common.vec_env.VecEnv` declares abstract.
ABSTRACT = (
    "reset step_async step_wait close get_attr set_attr env_method env_is_wrapped get_images"
).split()


class VecEnv:
    """What the constructor and `seed`, `step` of the base class do."""

    def __init__(self, num_envs, observation_space, action_space):
        self.num_envs = num_envs
        self.observation_space, self.action_space = observation_space, action_space
        self.reset_infos = [{} for _ in range(num_envs)]
        self._seeds = [None for _ in range(num_envs)]
        self._options = [{} for _ in range(num_envs)]
        modes = self.get_attr("render_mode")
        assert all(mode == modes[0] for mode in modes)
        self.render_mode = modes[0]

    def seed(self, seed):
        self._seeds = [seed + i for i in range(self.num_envs)]
        return self._seeds

    def step(self, actions):
        self.step_async(actions)
        return self.step_wait()


@pytest.fixture
def library(monkeypatch):
    names = ["stable_baselines3", "stable_baselines3.common", "stable_baselines3.common.vec_env"]
    for name in names:
        monkeypatch.setitem(sys.modules, name, type(sys)(name))
    sys.modules[names[-1]].VecEnv = VecEnv
    stable_baselines._vec_env_class.cache_clear()
    yield
    stable_baselines._vec_env_class.cache_clear()


@pytest.fixture
def envs(library):
    return stable_baselines.vec_env("fast", num_envs=3, max_episode_steps=2)


def test_is_a_vec_env_with_all_its_methods(envs):
    assert isinstance(envs, VecEnv)
    assert [name for name in ABSTRACT if not callable(getattr(envs, name, None))] == []
    assert envs.observation_space.shape == (1,)
    assert envs.action_space.shape == (1,)
    assert (envs.num_envs, envs.render_mode) == (3, None)


def test_the_usual_time_limit_holds(library):
    assert stable_baselines.vec_env("fast", 2).envs.env.max_episode_steps == 20


def test_a_step_has_the_types_that_learners_store(envs):
    obs = envs.reset()
    assert (obs.shape, obs.dtype) == ((3, 1), np.float32)
    assert [set(info) for info in envs.reset_infos] == [{"distance", "nonfinite", "steps"}] * 3
    obs, reward, done, infos = envs.step(np.zeros((3, 1), np.float32))
    assert (obs.dtype, reward.dtype, done.dtype) == (np.float32, np.float32, bool)
    assert (obs.shape, reward.shape, done.shape) == ((3, 1), (3,), (3,))
    assert infos == [{}, {}, {}]


def test_an_end_restarts_and_keeps_the_last_observation(envs):
    envs.seed(5)
    first = envs.reset()
    twin = gymnasium.make("jaxsim/Fast-v0")
    np.testing.assert_array_equal(first[1], twin.reset(seed=6)[0])
    envs.step(np.zeros((3, 1)))
    obs, _, done, infos = envs.step(np.zeros((3, 1)))
    assert done.all()
    np.testing.assert_array_equal(obs[1], twin.reset()[0])
    for start, info in zip(first, infos, strict=True):
        np.testing.assert_allclose(info["terminal_observation"], start, rtol=1e-6)
        assert info["TimeLimit.truncated"] is True


def test_a_termination_is_no_truncation(library):
    envs = stable_baselines.vec_env("fast", num_envs=1, max_episode_steps=None)
    envs.reset()
    for _ in range(40):
        _, _, done, infos = envs.step(np.ones((1, 1)))
        if done[0]:
            break
    assert infos[0]["TimeLimit.truncated"] is False


def test_seeds_are_used_once(envs):
    envs.seed(0)
    first = envs.reset()
    assert not np.any(envs.reset() == first)
    envs.seed(0)
    np.testing.assert_array_equal(envs.reset(), first)


def test_attributes_and_methods(envs):
    assert envs.get_attr("num_envs", indices=0) == [3]
    assert envs.env_is_wrapped(gymnasium.Wrapper) == [False] * 3
    assert envs.env_method("render") == [None] * 3
    assert envs.get_images() == [None] * 3
    with pytest.raises(AttributeError):
        envs.get_attr("no_such_attribute")
    with pytest.raises(AttributeError, match="cannot be set"):
        envs.set_attr("gravity", 0)
    with pytest.raises(ValueError, match="act together"):
        envs.env_method("render", indices=[0])
    envs.close()


def test_without_the_library_the_error_says_what_to_install(monkeypatch):
    stable_baselines._vec_env_class.cache_clear()
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    with pytest.raises(ModuleNotFoundError, match="pip install stable-baselines3"):
        stable_baselines.vec_env("fast")
