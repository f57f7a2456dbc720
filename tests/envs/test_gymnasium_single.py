"""`gymnasium.make("jaxsim/...")`: Gymnasium's own checks, and the rules of Stable-Baselines3."""

import os
import re
import subprocess
import sys

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.utils.env_match import check_environments_match

import jaxsim.envs
from jaxsim.envs.bridges import gymnasium_id, register_gymnasium, single
from jaxsim.envs.bridges.constant import Constant
from jaxsim.envs.bridges.vector import GymnasiumVectorEnv
from jaxsim.envs.registry import entries
from jaxsim.lanes import switch

UNBOUNDED = "ignore:.*Box observation space m.*imum value is -?infinity.*:UserWarning"


@pytest.fixture
def env():
    made = gymnasium.make("jaxsim/Fast-v0")
    yield made
    made.close()


def test_every_environment_has_an_id():
    ids = {gymnasium_id(name) for name in jaxsim.envs.names()}
    assert {"jaxsim/HalfCheetah-v0", "jaxsim/Walker2d-v0", "jaxsim/Ant-v0"} <= ids
    assert ids <= set(gymnasium.registry)
    assert len(ids) == len(jaxsim.envs.names())


@pytest.mark.parametrize(("setting", "kernels"), [(None, 1), (False, 0)])
def test_its_step_is_a_kernel_unless_they_are_off(monkeypatch, setting, kernels):
    made = []
    monkeypatch.setattr(single, "as_kernel", lambda f: made.append(f) or f)
    monkeypatch.setattr(single, "_step", single._step.__wrapped__)
    monkeypatch.setattr(switch, "_enabled", setting)
    monkeypatch.setattr(switch, "lanes_installed", lambda: True)
    single.GymnasiumEnv("fast").reset(seed=0)
    assert len(made) == kernels


def test_a_batch_of_models_is_refused():
    env = jaxsim.envs.make("fast")
    envs = jax.tree.map(lambda x: jnp.stack([x, x]), env)
    for bridge in (single.GymnasiumEnv, GymnasiumVectorEnv):
        with pytest.raises(ValueError, match=r"batch of models of shape \(2,\)"):
            bridge(envs)


def test_registering_twice_changes_nothing():
    before = gymnasium.registry["jaxsim/Fast-v0"]
    assert register_gymnasium("fast") == "jaxsim/Fast-v0"
    assert gymnasium.registry["jaxsim/Fast-v0"] is before


def test_an_environment_of_ones_own_has_an_id_too(monkeypatch):
    monkeypatch.setattr(entries, "_SPECS", dict(entries._SPECS))
    monkeypatch.setattr(gymnasium.envs.registration, "registry", dict(gymnasium.registry))
    jaxsim.envs.register("my_fast", jaxsim.envs.spec("fast").load(), max_episode_steps=3)
    env = gymnasium.make("jaxsim/MyFast-v0")
    env.reset(seed=0)
    assert [env.step([0.0])[3] for _ in range(3)] == [False, False, True]
    jaxsim.envs.register("my_fast", jaxsim.envs.spec("fast").load(), max_episode_steps=2)
    env = gymnasium.make("jaxsim/MyFast-v0")
    env.reset(seed=0)
    assert [env.step([0.0])[3] for _ in range(2)] == [False, True]


def test_gymnasium_alone_finds_the_environments_by_module():
    """Processes by fork, after the parent has made an environment to ask for its spaces."""
    code = """if True:
        import gymnasium
        make = lambda: gymnasium.make("jaxsim.envs:jaxsim/Fast-v0")
        envs = gymnasium.vector.AsyncVectorEnv([make, make], context="fork")
        observations, _ = envs.reset(seed=0)
        envs.close()
        print(observations.tolist(), make().reset(seed=1)[0].tolist())
    """
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    both, second = re.findall(r"\[[^ ]*\]", done.stdout.replace(", ", ","))
    assert both.endswith(f"{second}]")


def test_a_process_forked_from_one_that_uses_jax_says_so():
    """It would wait for ever: the threads of JAX are not there."""
    env = gymnasium.make("jaxsim/Fast-v0")
    env.reset(seed=0)
    ear, mouth = os.pipe()
    child = os.fork()
    if child == 0:
        try:
            gymnasium.make("jaxsim/Fast-v0").reset(seed=0)
        except RuntimeError as error:
            os.write(mouth, str(error).encode())
        finally:
            os._exit(0)
    os.waitpid(child, 0)
    assert 'context="spawn" or "forkserver"' in os.read(ear, 10_000).decode()
    env.reset(seed=0)  # here everything is as it was


@pytest.mark.filterwarnings(UNBOUNDED)
def test_gymnasiums_checker_is_content(env):
    check_env(env.unwrapped, skip_render_check=True)


def test_the_same_seed_gives_the_same_episodes(env):
    twin = gymnasium.make("jaxsim/Fast-v0")
    check_environments_match(env, twin, num_steps=25, seed=3, info_comparison="equivalence")


def test_seeds_differ_and_episodes_of_one_seed_differ():
    env = gymnasium.make("jaxsim/Fast-v0")
    starts = [env.reset(seed=seed)[0].item() for seed in (0, 1, 2**40)]
    starts += [env.reset()[0].item(), env.reset()[0].item()]
    assert len(set(starts)) == 5


def test_without_a_seed_two_environments_differ():
    starts = {gymnasium.make("jaxsim/Fast-v0").reset()[0].item() for _ in range(3)}
    assert len(starts) == 3


def test_a_step_is_that_of_the_environment(env):
    obs, _ = env.reset(seed=5)
    inner = env.unwrapped.env
    expected = inner.step(env.unwrapped.state, np.array([0.5], np.float32))
    obs, reward, terminated, truncated, info = env.step(np.array([0.5]))
    np.testing.assert_allclose(obs, expected.obs, rtol=1e-6)
    assert reward == pytest.approx(float(expected.reward), rel=1e-6)
    distance = pytest.approx(float(expected.metrics["distance"]), rel=1e-6)
    assert info == {"distance": distance, "nonfinite": 0.0}
    assert (terminated, truncated) == (False, False)


def test_time_limit_is_gymnasiums():
    env = gymnasium.make("jaxsim/Fast-v0")
    env.reset(seed=0)
    ends = [env.step([0.0])[2:4] for _ in range(20)]
    assert ends == [(False, False)] * 19 + [(False, True)]
    env = gymnasium.make("jaxsim/Fast-v0", max_episode_steps=2)
    env.reset(seed=0)
    assert [env.step([0.0])[3] for _ in range(2)] == [False, True]


def test_termination_is_told():
    env = gymnasium.make("jaxsim/Fast-v0", max_episode_steps=1000)
    env.reset(seed=0)
    ended = [env.step([1.0])[2] for _ in range(40)]
    assert ended.index(True) > 9


def test_what_stable_baselines_asks_for(env):
    """Its `check_env`: float32 boxes, finite actions, Python floats and bools, observations."""
    assert isinstance(env.action_space, gymnasium.spaces.Box)
    assert env.action_space.dtype == env.observation_space.dtype == np.float32
    assert np.isfinite([env.action_space.low, env.action_space.high]).all()
    assert env.observation_space.shape == (1,)
    obs, info = env.reset(seed=0)
    assert type(obs) is np.ndarray
    assert obs in env.observation_space
    assert type(info) is dict
    obs, reward, terminated, truncated, info = env.step(env.action_space.sample())
    assert obs in env.observation_space
    assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
    assert type(info) is dict


def test_what_is_not_finite_ends_the_episode_and_goes_nowhere(env):
    start, _ = env.reset(seed=0)
    obs, reward, terminated, truncated, info = env.step([np.nan])
    np.testing.assert_array_equal(obs, start)
    assert (reward, terminated, truncated) == (0.0, True, False)
    assert info == {"distance": 0.0, "nonfinite": 1.0}


def test_observations_are_the_users_to_write(env):
    first, _ = env.reset(seed=0)
    kept = first.copy()
    first[:] = 7
    second, *_ = env.step([0.0])
    np.testing.assert_array_equal(second, kept)


def test_double_precision(x64):
    env = gymnasium.make("jaxsim/Fast-v0", model=jaxsim.envs.load_asset("fast"))
    assert env.observation_space.dtype == np.float64
    obs, _ = env.reset(seed=0)
    assert obs in env.observation_space


def test_equal_environments_are_compiled_once(env):
    env.reset(seed=0)
    env.step([0.0])
    twin = gymnasium.make("jaxsim/Fast-v0")
    twin.reset(seed=1)
    twin.step([0.0])
    layout = env.unwrapped._layout
    program, _ = single._step(env.unwrapped._placed, layout)
    assert single._step(twin.unwrapped._placed, twin.unwrapped._layout)[0] is program
    assert program._cache_size() == 1


def test_another_model_is_another_program(env):
    inner = env.unwrapped.env
    heavy = inner.with_model(inner.model.replace(body_mass=2 * inner.model.body_mass))
    assert single._restart(Constant(heavy)) is not single._restart(env.unwrapped._placed)


def test_a_state_can_be_kept_and_set_again(env):
    """Steps from it are those that were made before, bit by bit."""
    env.reset(seed=0)
    kept = env.unwrapped.state
    first = env.step([0.3])
    env.step([0.1])
    env.unwrapped.state = kept
    again = env.step([0.3])
    np.testing.assert_array_equal(first[0], again[0])
    assert first[1:] == again[1:]


def test_mistakes_are_named(env):
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        env.unwrapped.step([0.0])
    with pytest.raises(TypeError, match="no option 'colour'"):
        gymnasium.make("jaxsim/Fast-v0", colour="red")
    with pytest.raises(ValueError, match="rgb_array"):
        type(env.unwrapped)("fast", render_mode="ascii")
    with pytest.raises(gymnasium.error.NameNotFound):
        gymnasium.make("jaxsim/Fats-v0")
