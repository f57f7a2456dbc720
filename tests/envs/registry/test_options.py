"""Options of environments and environments by module: mistakes are told before anything runs."""

import jax.numpy as jnp
import pytest

from jaxsim.envs import TimeLimit, make, register, spec
from jaxsim.envs.fast import Fast


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("fast", {"frame_skip": "a"}, "'frame_skip' of fast must be a positive whole number"),
        ("fast", {"frame_skip": 0}, "must be a positive whole number, got 0"),
        ("fast", {"frame_skip": 1.5}, "must be a positive whole number, got 1.5"),
        ("fast", {"model": 3}, "must be a model, as from jaxsim.load, got 3"),
        (
            "swimmer",
            {"reset_noise_scale": "abc"},
            "'reset_noise_scale' of swimmer must be a number",
        ),
        ("swimmer", {"reset_noise_scale": True}, "must be a number, got True"),
        ("swimmer", {"reset_noise_scale": float("nan")}, "must be a number, got nan"),
        ("hopper", {"terminate_when_unhealthy": 1}, "must be true or false, got 1"),
        ("hopper", {"healthy_z_range": 0.7}, "must be 2 numbers, got 0.7"),
        ("hopper", {"healthy_z_range": [0.7, "x"]}, "must be 2 numbers, got"),
        ("ant", {"main_body": 1.5}, "must be a whole number"),
    ],
)
def test_a_value_of_the_wrong_kind_is_told(name, options, message):
    with pytest.raises(TypeError, match=message):
        make(name, **options)


def test_everything_wrong_is_told_at_once():
    with pytest.raises(TypeError, match="no option 'frame_skp'.*'frame_skip' of fast must be"):
        make("fast", frame_skp=1, frame_skip=0)


def test_values_of_the_right_kind_pass():
    hopper = make("hopper", healthy_z_range=[0.5, 2], reset_noise_scale=jnp.float32(0.1)).unwrapped
    assert hopper.healthy_z_range == (0.5, 2)
    assert make("ant", main_body="torso").unwrapped.main_body == "torso"


def test_a_task_by_its_module():
    env = make("jaxsim.envs.fast:Fast")
    assert isinstance(env, TimeLimit)
    assert env.max_episode_steps == 20  # as it is registered
    assert spec("jaxsim.envs.fast:fast").load() is Fast


@pytest.mark.parametrize(
    ("path", "error", "message"),
    [
        ("no_such_module:X", KeyError, "No module named 'no_such_module'"),
        ("jaxsim.envs:Nothing", KeyError, "there is no 'Nothing' in the module 'jaxsim.envs'"),
        (":", KeyError, "not of the form module:name"),
        ("..x:y", KeyError, "not of the form module:name"),
        ("os:system", TypeError, "a task is a class that derives from jaxsim.envs.Task"),
        ("collections:Counter", TypeError, "a task is a class that derives"),
    ],
)
def test_what_is_no_task_is_told(path, error, message):
    with pytest.raises(error, match=message):
        make(path)


def test_a_length_that_makes_no_sense_is_refused_at_once():
    for length in (0, -1, True, 1.5, "x"):
        with pytest.raises(ValueError, match="positive whole number or None"):
            register("no-length", Fast, max_episode_steps=length)
