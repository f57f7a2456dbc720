"""Settings: files, assignments, and what is said about mistakes."""

import dataclasses
import pathlib

import pytest

import jaxsim.rl
from jaxsim.rl import config, ppo
from jaxsim.rl.config import ConfigError

FILES = sorted((pathlib.Path(__file__).parents[2] / "configs").glob("*/*.yaml"))


def test_values_replace_defaults_and_nothing_else():
    built = config.build(ppo.Config, {"unroll": 7, "policy": {"activation": "relu"}})
    assert built == dataclasses.replace(
        ppo.Config(), unroll=7, policy=config.NetworkConfig(activation="relu")
    )


def test_assignments_are_yaml():
    changed = config.override(
        ppo.Config(),
        ["policy.hidden=[32, 16]", "total_steps=2e6", "target=900", "learning_rate=1e-3"],
    )
    assert changed.policy.hidden == (32, 16)
    assert (changed.total_steps, type(changed.total_steps)) == (2_000_000, int)
    assert (changed.target, changed.learning_rate) == (900.0, 1e-3)
    assert config.override(changed, ["target=null"]).target is None
    assert config.override(ppo.Config(), ["env_options={a: 1}"]).env_options == {"a": 1}


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        ("learning_rat=1", "unknown setting 'learning_rat'; did you mean learning_rate"),
        ("policy.hiden=1", "unknown setting 'policy.hiden'; did you mean hidden"),
        ("xyz=1", "known are .*clip, .*unroll"),
        ("unroll", "expected key=value, got 'unroll'"),
        ("unroll=1.5", "unroll must be of type int, got 1.5"),
        ("unroll=true", "unroll must be of type int, got True"),
        ("discount=high", "discount must be of type float, got 'high'"),
        ("normalize_obs=1", "normalize_obs must be of type bool, got 1"),
        ("policy=64", "policy must be a mapping, got 64"),
    ],
)
def test_mistakes_are_errors_that_help(assignment, message):
    with pytest.raises(ConfigError, match=message):
        config.override(ppo.Config(), [assignment])


def test_plain_settings_can_be_read_back():
    settings = config.override(
        ppo.Config(), ["policy.hidden=[3]", "target=1", "env_options={a: 1}"]
    )
    assert config.build(ppo.Config, config.plain(settings)) == settings


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ConfigError, match="cannot read .*missing.yaml"):
        config.read(tmp_path / "missing.yaml")
    (tmp_path / "list.yaml").write_text("[1]")
    with pytest.raises(ConfigError, match=r"must contain a mapping of settings, got \[1\]"):
        config.read(tmp_path / "list.yaml")
    (tmp_path / "bad.yaml").write_text("a: [")
    with pytest.raises(ConfigError, match="not valid YAML"):
        config.read(tmp_path / "bad.yaml")


@pytest.mark.parametrize("path", FILES, ids=lambda p: f"{p.parent.name}-{p.stem}")
def test_tuned_settings_are_found_and_make_sense(path):
    assert config.find(path.parent.name, path.stem) == path
    assert path.stem in jaxsim.envs.names()
    jaxsim.rl.resolve(path.stem, path.parent.name)
    header = path.read_text("utf-8").splitlines()[0]
    assert header.startswith("#"), "the first line says what return these settings gave"


def test_there_are_tuned_settings_for_the_classic_tasks():
    assert {p.stem for p in FILES if p.parent.name == "ppo"} >= {
        *("inverted_pendulum", "reacher", "inverted_double_pendulum", "swimmer", "hopper"),
        *("half_cheetah", "walker2d", "ant", "humanoid"),
    }


def test_unknown_algorithm_and_environment():
    with pytest.raises(ConfigError, match="unknown algorithm 'pppo'; did you mean ppo"):
        jaxsim.rl.resolve("fast", "pppo")
    with pytest.raises(ConfigError, match="did you mean fast"):
        jaxsim.rl.train("fasst", settings={})
    with pytest.raises(ConfigError, match="has no option 'frame_skp'; did you mean frame_skip"):
        jaxsim.rl.train("fast", settings={"env_options": {"frame_skp": 1}})
    with pytest.raises(ConfigError, match="settings of ppo must be a mapping, a file or a"):
        jaxsim.rl.train("fast", settings=3)
