"""Every task in Gymnasium: its checker, and the vector beside single environments."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import jaxsim.envs
from jaxsim.envs.bridges import gymnasium_id

BUNDLED = [n for n in jaxsim.envs.names() if isinstance(jaxsim.envs.spec(n).cls, str)]
ADVICE = "ignore:.*(Box observation space m|For Box action spaces, we recommend):UserWarning"


@pytest.mark.parametrize("name", BUNDLED)
def test_actions_are_bounded(name):
    """Learners of other libraries scale actions by their bounds."""
    env = jaxsim.envs.spec(name).load()()
    assert np.isfinite(env.action_low).all()
    assert np.isfinite(env.action_high).all()
    assert np.all(env.action_low < env.action_high)


@pytest.mark.slow
@pytest.mark.filterwarnings(ADVICE)
@pytest.mark.parametrize("name", BUNDLED)
def test_gymnasiums_checker_is_content(name):
    check_env(gymnasium.make(gymnasium_id(name)).unwrapped, skip_render_check=True)


@pytest.mark.slow
@pytest.mark.parametrize("name", BUNDLED)
def test_the_vector_does_what_single_environments_do(name):
    envs = gymnasium.make_vec(gymnasium_id(name), num_envs=2)
    singles = [gymnasium.make(gymnasium_id(name)).unwrapped for _ in range(2)]
    envs.action_space.seed(0)
    observations, _ = envs.reset(seed=3)
    for i, single in enumerate(singles):
        np.testing.assert_allclose(observations[i], single.reset(seed=3 + i)[0], atol=1e-5)
    for _ in range(3):
        actions = envs.action_space.sample()
        obs, reward, terminated, _, infos = envs.step(actions)
        for i, single in enumerate(singles):
            expected, gain, ended, _, info = single.step(actions[i])
            np.testing.assert_allclose(obs[i], expected, rtol=1e-3, atol=1e-3)
            assert reward[i] == pytest.approx(gain, rel=1e-3, abs=1e-3)
            assert terminated[i] == ended
            assert set(info) <= set(infos)
