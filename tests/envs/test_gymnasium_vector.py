"""`gymnasium.make_vec("jaxsim/...")` against Gymnasium's own vector of single environments."""

import gymnasium
import jax
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv, VectorEnv
from gymnasium.vector.utils import batch_space

import jaxsim.envs  # noqa: F401

MODES = list(AutoresetMode)


def make_vec(n=4, **options) -> VectorEnv:
    return gymnasium.make_vec("jaxsim/Fast-v0", num_envs=n, max_episode_steps=5, **options)


def make_sync(n=4, mode=AutoresetMode.NEXT_STEP) -> SyncVectorEnv:
    single = lambda: gymnasium.make("jaxsim/Fast-v0", max_episode_steps=5)  # noqa: E731
    return SyncVectorEnv([single] * n, autoreset_mode=mode)


def assert_same(ours, theirs):
    """Nested infos, arrays and object arrays of arrays; our step counter is not in theirs."""
    if isinstance(theirs, dict):
        names = {name for name in ours if name.removeprefix("_") != "steps"}
        assert names == set(theirs)
        for name in theirs:
            assert_same(ours[name], theirs[name])
    elif theirs.dtype == object:
        assert [x is None for x in ours] == [x is None for x in theirs]
        for x, y in zip(ours, theirs, strict=True):
            if y is not None:
                np.testing.assert_allclose(x, y, rtol=1e-6)
    else:
        np.testing.assert_allclose(ours, theirs, rtol=1e-6)


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_agrees_with_gymnasiums_vector_of_our_single_environments(mode):
    """Same seeds, same actions: same episodes, ends, last observations and infos."""
    ours, theirs = make_vec(autoreset_mode=mode), make_sync(mode=mode)
    ours.action_space.seed(0)
    first, second = ours.reset(seed=11), theirs.reset(seed=11)
    done = np.zeros(4, bool)
    for _ in range(13):
        assert_same(first[0], second[0])
        assert_same(first[-1], second[-1])
        if mode is AutoresetMode.DISABLED and done.any():
            mask = {"reset_mask": done}
            first, second = ours.reset(options=dict(mask)), theirs.reset(options=dict(mask))
            done = np.zeros(4, bool)
            continue
        actions = ours.action_space.sample()
        first, second = ours.step(actions), theirs.step(actions)
        for mine, other in zip(first[1:4], second[1:4], strict=True):
            np.testing.assert_allclose(mine, other, rtol=1e-6)
            assert mine.dtype == other.dtype
        done = first[2] | first[3]


@pytest.mark.parametrize("mode", MODES, ids=lambda mode: mode.name)
def test_says_its_mode_and_spaces(mode):
    envs = make_vec(autoreset_mode=mode)
    assert isinstance(envs, VectorEnv)
    assert envs.metadata["autoreset_mode"] is mode
    assert envs.num_envs == 4
    assert envs.observation_space == batch_space(envs.single_observation_space, 4)
    assert envs.action_space == batch_space(envs.single_action_space, 4)
    obs, _ = envs.reset(seed=0)
    assert obs in envs.observation_space
    obs, reward, terminated, truncated, info = envs.step(envs.action_space.sample())
    assert obs in envs.observation_space
    assert (reward.dtype, terminated.dtype, truncated.dtype) == (float, bool, bool)
    assert reward.shape == terminated.shape == truncated.shape == (4,)


def test_the_spec_makes_the_same_again():
    envs = make_vec(autoreset_mode="SameStep")
    again = gymnasium.make_vec(envs.spec)
    assert again.num_envs == 4
    assert again.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    np.testing.assert_array_equal(envs.reset(seed=1)[0], again.reset(seed=1)[0])


def test_seeds_are_those_of_the_environments():
    envs, other = make_vec(), make_vec()
    by_number, _ = envs.reset(seed=7)
    by_list, _ = other.reset(seed=[7, 8, 9, 10])
    np.testing.assert_array_equal(by_number, by_list)
    single = gymnasium.make("jaxsim/Fast-v0")
    np.testing.assert_array_equal(by_number[2], single.reset(seed=9)[0])
    assert len(np.unique(by_number)) == 4
    assert not np.any(envs.reset()[0] == by_number)


def test_a_seed_of_none_continues_that_environment():
    envs = make_vec(2)
    envs.reset(seed=0)
    expected, _ = envs.reset()
    envs.reset(seed=0)
    mixed, _ = envs.reset(seed=[5, None])
    assert mixed[1] == expected[1]
    assert mixed[0] != expected[0]


def test_unseeded_batches_differ():
    assert not np.any(make_vec().reset()[0] == make_vec().reset()[0])


def test_a_mask_restarts_only_what_is_in_it():
    envs = make_vec()
    before, _ = envs.reset(seed=0)
    mask = np.array([False, True, False, True])
    after, info = envs.reset(options={"reset_mask": mask})
    np.testing.assert_array_equal(after[~mask], before[~mask])
    assert not np.any(after[mask] == before[mask])
    np.testing.assert_array_equal(info["_distance"], mask)


def test_many_environments_end_at_once_and_one_by_one():
    """More than one chunk of resets, and environments that end at different times."""
    envs = gymnasium.make_vec("jaxsim/Fast-v0", num_envs=150, autoreset_mode="SameStep")
    envs.reset(seed=0)
    ended = np.zeros(150, int)
    for _ in range(20):
        obs, _, terminated, truncated, info = envs.step(np.ones((150, 1)))
        done = terminated | truncated
        ended += done
        assert np.all(np.abs(obs[done]) < 1)
        if done.any():
            last = np.concatenate(info["final_obs"][done])
            assert np.all((np.abs(last) > 2) == terminated[done])
    assert np.all(ended == 1)


def test_what_is_not_finite_ends_that_environment_only():
    envs = make_vec(autoreset_mode="SameStep")
    envs.reset(seed=0)
    actions = np.zeros((4, 1))
    actions[2] = np.nan
    obs, reward, terminated, _, info = envs.step(actions)
    np.testing.assert_array_equal(terminated, [False, False, True, False])
    np.testing.assert_array_equal(info["final_info"]["nonfinite"], [0, 0, 1, 0])
    assert np.isfinite(obs).all()
    assert np.isfinite(info["final_obs"][2]).all()
    assert reward[2] == 0
    assert np.all(reward[[0, 1, 3]] != 0)


def test_a_batch_that_devices_do_not_divide_is_on_one():
    assert make_vec(4)._mesh.size == len(jax.devices()) == 2
    envs = make_vec(3)
    assert envs._mesh.size == 1
    assert envs.reset(seed=0)[0].shape == (3, 1)


def test_results_are_the_users_to_keep_and_to_write():
    envs = make_vec()
    kept, _ = envs.reset(seed=0)
    copy = kept.copy()
    first = envs.step(np.zeros((4, 1)))
    np.testing.assert_array_equal(kept, copy)
    first[0][:], first[1][:], first[4]["distance"][:] = 9, 9, 9
    np.testing.assert_array_equal(envs.step(np.zeros((4, 1)))[0], copy)


def test_states_stay_readable():
    envs = make_vec()
    envs.reset(seed=0)
    before = envs.states
    copy = np.array(before.obs)
    envs.step(np.ones((4, 1)))
    np.testing.assert_array_equal(before.obs, copy)
    envs.reset(options={"reset_mask": np.array([True, False, False, False])})
    np.testing.assert_array_equal(before.obs, copy)
    assert np.all(envs.states.obs != copy)


def test_no_limit_may_be_said_as_gymnasium_says_it():
    for limit in ({"max_episode_steps": -1}, {}):
        envs = gymnasium.make_vec("jaxsim/Fast-v0", num_envs=1, **limit)
        envs.reset(seed=0)
        cuts = [envs.step(np.zeros((1, 1)))[3][0] for _ in range(25)]
        assert any(cuts) == (not limit)


def test_another_model_can_take_its_place():
    envs = make_vec()
    start, _ = envs.reset(seed=0)
    model = envs.env.model
    slow = model.replace(opt=model.opt.replace(timestep=0.5 * model.opt.timestep))
    envs.env = envs.env.with_model(slow)
    np.testing.assert_allclose(envs.step(np.ones((4, 1)))[0], start + 0.05, rtol=1e-5)


def test_gymnasiums_vector_wrappers_fit():
    envs = gymnasium.wrappers.vector.RecordEpisodeStatistics(make_vec(autoreset_mode="NextStep"))
    envs.reset(seed=0)
    for _ in range(5):
        *_, info = envs.step(np.zeros((4, 1)))
    np.testing.assert_array_equal(info["episode"]["l"], 5)


def test_mistakes_are_named():
    envs = make_vec(autoreset_mode="Disabled")
    with pytest.raises(gymnasium.error.ResetNeeded, match="call reset"):
        envs.step(np.zeros((4, 1)))
    with pytest.raises(gymnasium.error.ResetNeeded, match="first reset"):
        envs.reset(options={"reset_mask": np.array([True, False, True, True])})
    envs.reset(seed=0)
    with pytest.raises(TypeError, match="numpy array of booleans"):
        envs.reset(options={"reset_mask": [True] * 4})
    with pytest.raises(TypeError, match="numpy array of booleans, got int64"):
        envs.reset(options={"reset_mask": np.ones(4, np.int64)})
    with pytest.raises(ValueError, match=r"shape \(4,\)"):
        envs.reset(options={"reset_mask": np.ones(3, bool)})
    with pytest.raises(ValueError, match="a True in it"):
        envs.reset(options={"reset_mask": np.zeros(4, bool)})
    with pytest.raises(ValueError, match="4 seeds"):
        envs.reset(seed=[1, 2])
    for _ in range(5):
        envs.step(np.zeros((4, 1)))
    with pytest.raises(gymnasium.error.ResetNeeded, match="have ended"):
        envs.step(np.zeros((4, 1)))
    with pytest.raises(ValueError, match="positive"):
        make_vec(0)
    with pytest.raises(ValueError, match="not a valid AutoresetMode"):
        make_vec(autoreset_mode="Sometimes")
