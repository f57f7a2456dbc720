"""Training as a whole: schedule, logs, resume to the last bit, interrupts, NaN, devices."""

import contextlib
import dataclasses
import importlib.util
import os
import signal

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import struct

from jaxsim import envs
from jaxsim.envs import Wrapper
from jaxsim.rl import config, driver, metrics, train
from jaxsim.rl.checkpoint import CheckpointError, Checkpoints
from jaxsim.rl.driver import load_policy
from jaxsim.rl.ppo import PPO

pytestmark = pytest.mark.usefixtures("compiled_once")


@pytest.fixture
def whole(tiny, compiled_once):
    """A training from beginning to end."""
    return train("fast", settings=tiny)


def test_history_and_evaluations(whole):
    result = whole
    assert [row["steps"] for row in result.history] == [128, 256, 384, 512]
    assert [row["steps"] for row in result.evaluations] == [256, 512]
    assert [row["eval_length"] for row in result.evaluations] == [20, 20]
    seconds = [row["seconds"] for row in result.history]
    assert seconds == sorted(seconds)
    assert not result.interrupted


def test_target_ends_training(tiny):
    result = train("fast", settings=tiny | {"target": -1e9})
    assert result.history[-1]["steps"] == 256


@pytest.mark.parametrize(
    ("target", "order"),
    [
        (None, "epoch epoch evaluate read epoch read read epoch evaluate"),
        (1e9, "epoch epoch evaluate read read read epoch epoch evaluate"),
    ],
)
def test_the_next_epoch_is_started_before_an_evaluation_is_read(tiny, monkeypatch, target, order):
    """Unless there is a target, which may be reached."""
    events = []

    def noted(name, f):
        return lambda *args: (events.append(name), f(*args))[1]

    compile_all = driver.compile_all

    def compiled(*args):
        programs = compile_all(*args)
        started = {n: noted(n, getattr(programs, n)) for n in ("epoch", "evaluate")}
        return dataclasses.replace(programs, **started)

    monkeypatch.setattr(driver, "compile_all", compiled)
    monkeypatch.setattr(jax, "device_get", noted("read", jax.device_get))
    train("fast", settings=tiny | {"target": target})
    assert " ".join(events).startswith(order)


def test_each_policy_is_watched_and_stays(whole, tiny, bits):
    """The epoch that follows reuses the memory of what the policy is copied from."""
    seen = []
    result = train("fast", settings=tiny, watch=seen.append)
    assert len({b"".join(bits(policy)) for policy in seen}) == 4
    assert bits(seen[-1]) == bits(result.policy) == bits(whole.policy)


def test_seed_decides_everything(whole, tiny, bits):
    again, other = (train("fast", settings=tiny, seed=s).training for s in (0, 1))
    assert bits(whole.training) == bits(again)
    assert bits(whole.training.learner.params) != bits(other.learner.params)


def interrupt_after(steps, monkeypatch):
    """Send this process the signal of Ctrl-C when a row has been written."""
    write = metrics.Logs.write

    def interrupted(self, row):
        write(self, row)
        if row["steps"] == steps:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(metrics.Logs, "write", interrupted)


def test_interrupt_saves_and_resume_is_bit_identical(whole, tiny, bits, tmp_path, monkeypatch):
    """The epoch in progress is finished and saved; what follows is as if nothing had happened."""
    directory, handler = tmp_path / "run", signal.getsignal(signal.SIGINT)
    with monkeypatch.context() as context:
        interrupt_after(128, context)
        first = train("fast", settings=tiny, directory=directory)
    assert first.interrupted
    assert [row["steps"] for row in first.history] == [128, 256]
    assert signal.getsignal(signal.SIGINT) is handler
    resumed = train("fast", settings=tiny, directory=directory, resume=True)
    assert [row["steps"] for row in resumed.history] == [384, 512]
    assert bits(resumed.training) == bits(whole.training)
    assert resumed.history[-1]["eval_return"] == whole.history[-1]["eval_return"]
    rows = metrics.read(directory / "metrics.jsonl")
    assert [row["steps"] for row in rows] == [128, 256, 384, 512]
    assert rows[-1]["seconds"] > rows[1]["seconds"]


def test_directory_of_a_run(whole, tiny, tmp_path, bits):
    with pytest.raises(CheckpointError, match="is not the directory of a run"):
        load_policy(tmp_path)
    train("fast", settings=tiny, directory=tmp_path / "run")
    assert bits(load_policy(tmp_path / "run")) == bits(whole.policy)
    board = importlib.util.find_spec("tensorboardX") is not None
    assert (tmp_path / "run" / "tensorboard").exists() == board
    with pytest.raises(CheckpointError, match="holds a run already; resume it, or choose"):
        train("fast", settings=tiny, directory=tmp_path / "run")


def test_a_finished_run_stays_as_it_is(whole, tiny, tmp_path, bits, monkeypatch):
    """Nothing is compiled or written: the total is reached, or the target is."""
    directory = tmp_path / "run"
    train("fast", settings=tiny | {"target": -1e9}, directory=directory)
    files = {path: path.read_bytes() for path in directory.rglob("*") if path.is_file()}
    with monkeypatch.context() as context:
        context.setattr(driver, "compile_all", None)
        again = train("fast", settings=tiny | {"target": -1e9}, directory=directory, resume=True)
    assert again.finished
    assert again.history == []
    assert bits(again.policy) == bits(load_policy(directory))
    assert {p: p.read_bytes() for p in directory.rglob("*") if p.is_file()} == files
    longer = train("fast", settings=tiny, directory=directory, resume=True)
    assert not longer.finished
    assert bits(longer.training) == bits(whole.training)


def test_a_run_of_another_kind_is_not_resumed(tiny, tmp_path):
    (tmp_path / "run.yaml").write_text("env: reacher\nalgorithm: ppo\nseed: 0\nsettings: {}\n")
    with pytest.raises(CheckpointError, match="is about reacher, not fast"):
        train("fast", settings=tiny, directory=tmp_path, resume=True)
    (tmp_path / "run.yaml").write_text("env: fast\nalgorithm: sac\nseed: 0\nsettings: {}\n")
    with pytest.raises(CheckpointError, match="is about sac, not ppo"):
        train("fast", settings=tiny, directory=tmp_path, resume=True)


def test_a_checkpoint_of_other_settings_is_told(tiny, tmp_path):
    train("fast", settings=tiny | {"total_steps": 128}, directory=tmp_path)
    other = tiny | {"policy": {"hidden": [9]}}
    with pytest.raises(CheckpointError, match=r"of other settings: .*is of shape \[.*, here of \["):
        train("fast", settings=other, directory=tmp_path, resume=True)


class Killed(BaseException):
    """The end of the process, as far as a test within it can have it."""


@pytest.mark.parametrize("moment", range(6))
def test_killed_at_any_moment_ends_bit_identical(whole, tiny, bits, tmp_path, monkeypatch, moment):
    """In the middle of a row, between row and checkpoint, within a checkpoint, after it."""
    directory = tmp_path / "run"
    places = [(metrics.Logs, "write"), (Checkpoints, "save")]
    owner, name = places[moment % 2]
    calls = iter(range(10))
    original = getattr(owner, name)

    def killed(self, *args):
        if next(calls) == moment // 2:
            if owner is metrics.Logs:
                self._file.write(b'{"steps": 12')
            raise Killed
        original(self, *args)

    with monkeypatch.context() as context:
        context.setattr(owner, name, killed)
        with contextlib.suppress(Killed):
            train("fast", settings=tiny, directory=directory)
    resumed = train("fast", settings=tiny, directory=directory, resume=True)
    assert bits(resumed.training) == bits(whole.training)
    rows = metrics.read(directory / "metrics.jsonl")
    assert [row["steps"] for row in rows] == [128, 256, 384, 512]
    assert len((directory / "metrics.jsonl").read_text().splitlines()) == 4


def test_environment_without_a_name(tiny, tmp_path):
    train(envs.make("fast"), settings=tiny, directory=tmp_path / "run")
    with pytest.raises(CheckpointError, match="an environment without a name; pass env"):
        load_policy(tmp_path / "run")
    policy = load_policy(tmp_path / "run", envs.make("fast"))
    assert policy(jnp.zeros(1)).shape == (1,)


@struct.dataclass
class Explosive(Wrapper):
    """Numbers go wrong wherever the point gets far to the right."""

    def step(self, state, action):
        after = self.env.step(state, action)
        bad = after.obs[0] > 1.0
        return after.replace(
            obs=jnp.where(bad, jnp.nan, after.obs), reward=jnp.where(bad, jnp.inf, after.reward)
        )


def test_environments_that_explode_are_counted_and_do_not_poison(tiny):
    result = train(Explosive(envs.make("fast")), settings=tiny)
    assert sum(row["nonfinite"] for row in result.history) > 0
    for leaf in jax.tree.leaves(jax.device_get(result.training)):
        if not jax.dtypes.issubdtype(leaf.dtype, jax.dtypes.prng_key):
            assert np.isfinite(leaf).all()
    assert np.isfinite(result.history[-1]["eval_return"])


def test_devices_learn_the_same(whole):
    """All parameters are the same on both devices, and environments are split between them."""
    training = whole.training
    for leaf in jax.tree.leaves(training.learner.params):
        one, two = (np.asarray(shard.data) for shard in leaf.addressable_shards)
        np.testing.assert_array_equal(one, two)
    lengths = training.actors.envs.episode_length
    assert [s.data.shape for s in lengths.addressable_shards] == [(4,), (4,)]


class Patient(PPO):
    """An algorithm of somebody's own."""

    @dataclasses.dataclass(frozen=True)
    class Config(PPO.Config):
        """Settings with other defaults."""

        learning_rate: float = 1e-5


def test_an_algorithm_of_ones_own(tiny, tmp_path):
    result = train("fast", Patient, settings=tiny, directory=tmp_path / "run")
    name = driver.algorithm_name(Patient)
    assert driver.algorithm_class(name) is Patient
    assert driver.resolve("fast", name).learning_rate == 1e-5
    with pytest.raises(CheckpointError, match="imported only if you name it too"):
        driver.load_policy(tmp_path / "run")
    with pytest.raises(CheckpointError, match="the algorithm of this run is .*, not 'ppo'"):
        driver.load_policy(tmp_path / "run", algorithm="ppo")
    restored = driver.load_policy(tmp_path / "run", algorithm=Patient)
    obs = jnp.ones(result.policy.statistics.mean.shape)
    np.testing.assert_array_equal(restored(obs), result.policy(obs))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("pop", "did you mean ppo"),
        ("no_such_module:A", "cannot import algorithm 'no_such_module:A'"),
        ("jaxsim.rl.ppo:POP", "cannot import algorithm"),
    ],
)
def test_no_such_algorithm(name, message):
    with pytest.raises(config.ConfigError, match=message):
        train("fast", name)


def test_train_takes_one_environment():
    with pytest.raises(config.ConfigError, match="one environment of jaxsim.envs, .* got int"):
        train(3)
    many = jax.vmap(lambda _: envs.make("fast"))(jnp.arange(2))
    with pytest.raises(config.ConfigError, match=r"holds a batch of models of shape \(2,\)"):
        train(many)


def test_settings_may_be_a_file_or_a_record(tiny, tmp_path):
    path = tmp_path / "settings.yaml"
    path.write_text("envs: 16\nunroll: 4\n")
    settings = driver.resolve("fast", "ppo", path, ["passes=3"])
    assert (settings.envs, settings.unroll, settings.passes) == (16, 4, 3)
    assert driver.resolve("fast", "ppo", settings) == settings
    assert driver.resolve("inverted_pendulum", "ppo") != driver.algorithm_class("ppo").Config()
    assert dataclasses.is_dataclass(settings)


def test_progress_bar_shows_reward_and_speed(tiny, capsys):
    train("fast", settings=tiny, progress=True)
    shown = capsys.readouterr().err
    for word in ("ppo on fast", "reward", "evaluated", "steps/s", "left"):
        assert word in shown
