"""Settings: files, assignments, and what is said about mistakes."""

import dataclasses
import pathlib

import jax
import pytest

import jaxsim.rl
from jaxsim.rl import config, ppo, shac
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
        ("unroll=1.5", "unroll must be a whole number, got 1.5"),
        ("unroll=true", "unroll must be a whole number, got True"),
        ("unroll=0", "unroll must be at least 1 and at most 2147483647, got 0"),
        ("envs=1e30", "envs must be at least 1 and at most 2147483647, got 1e[+]30"),
        ("total_steps=.inf", "total_steps must be a whole number, got inf"),
        ("total_steps=[1", "cannot read the value in 'total_steps=.1'"),
        ("discount=high", "discount must be a finite number, got 'high'"),
        ("discount=2", "discount must be at least 0 and at most 1, got 2"),
        ("learning_rate=-1", "learning_rate must be more than 0, got -1"),
        ("learning_rate=.inf", "learning_rate must be a finite number, got inf"),
        ("normalize_obs=1", "normalize_obs must be true or false, got 1"),
        ("schedule=cosine", "schedule must be linear, constant or kl, got 'cosine'"),
        ("policy.activation=foo", "policy.activation must be tanh, relu, elu or swish, got 'foo'"),
        ("policy.hidden=[8, -1]", "policy.hidden must be at least 1 .*got -1"),
        ("policy=64", "policy must be a mapping, got 64"),
        ("env_options=3", "env_options must be a mapping, got 3"),
        ("learning_rate.x=1", "learning_rate must be a finite number, got {'x': 1}"),
    ],
)
def test_mistakes_are_errors_that_help(assignment, message):
    with pytest.raises(ConfigError, match=message):
        config.override(ppo.Config(), [assignment])


def test_all_mistakes_are_told_at_once():
    """Of several assignments, within a record in a record, and of a mapping."""
    with pytest.raises(ConfigError) as caught:
        config.override(ppo.Config(), ["envs=0", "xyz=1", "policy.hidden=[0]", "clip=[1"])
    assert len(caught.value.problems) == 4
    assert str(caught.value).startswith("4 settings are wrong:\n- cannot read")
    with pytest.raises(ConfigError) as caught:
        config.build(ppo.Config, {"unroll": 0, "value": {"activation": "x", "hidden": "y"}})
    assert [text.split()[0] for text in caught.value.problems] == [
        *("unroll", "value.activation", "value.hidden")
    ]


def test_records_check_themselves():
    with pytest.raises(ConfigError, match="total_steps must be at least 1 .* got -5"):
        ppo.Config(total_steps=-5)
    with pytest.raises(ConfigError, match="must be a finite number, got nan"):
        dataclasses.replace(ppo.Config(), learning_rate=float("nan"))
    with pytest.raises(ConfigError, match="activation must be tanh"):
        config.NetworkConfig(activation="foo")
    assert isinstance(ppo.Config(total_steps=1e6).total_steps, int)


@pytest.mark.parametrize("value", ["0.9", "[0.9]", "[0.9, 1]", "[0.9, 0.99, 0.999]"])
def test_momentum_is_two_factors_below_one(value):
    with pytest.raises(ConfigError, match="momentum must be (2 values|.* less than 1)"):
        config.override(shac.Config(), [f"momentum={value}"])


def test_an_assignment_to_an_option_leaves_the_others():
    options = config.override(ppo.Config(), ["env_options={a: 1, b: 2}", "env_options.b=1e-3"])
    assert options.env_options == {"a": 1, "b": 1e-3}


def test_plain_settings_can_be_read_back():
    settings = config.override(
        ppo.Config(), ["policy.hidden=[3]", "target=1", "env_options={a: 1}"]
    )
    assert config.build(ppo.Config, config.plain(settings)) == settings


def test_settings_for_a_gpu_take_the_place_of_others(monkeypatch):
    given = {"envs": 8, "unroll": 4, "gpu": {"envs": 4096}}
    assert jaxsim.rl.resolve("fast", "ppo", given).envs == 8
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    found = jaxsim.rl.resolve("fast", "ppo", given, ["unroll=2"])
    assert (found.envs, found.unroll) == (4096, 2)
    with pytest.raises(ConfigError, match="gpu must be a mapping"):
        jaxsim.rl.resolve("fast", "ppo", {"gpu": 3})


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
    settings = jaxsim.rl.resolve(path.stem, path.parent.name)
    on_gpu = config.for_device(config.read(path), "gpu")
    assert config.build(type(settings), on_gpu).envs >= settings.envs
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
    options = {"frame_skp": 1, "frame_skip": "a", "model": 3}
    with pytest.raises(
        ConfigError, match="no option 'frame_skp'; did you mean frame_skip"
    ) as found:
        jaxsim.rl.train("fast", settings={"env_options": options})
    assert "'frame_skip' of fast must be a positive whole number, got 'a'" in str(found.value)
    assert "'model' of fast must be a model, as from jaxsim.load, got 3" in str(found.value)
    for name in ("os:system", ":", "..x:y", "collections:Counter", "jaxsim.rl:Nothing"):
        with pytest.raises(ConfigError, match="algorithm"):
            jaxsim.rl.resolve("fast", name)
    with pytest.raises(ConfigError, match="settings of ppo must be a mapping, a file or a"):
        jaxsim.rl.train("fast", settings=3)
