"""The directory of a run: one writer at a time, and one sentence for whatever is in the way."""

import errno
import shutil
from types import SimpleNamespace

import pytest

from jaxsim.rl import config, metrics, ppo, train
from jaxsim.rl.checkpoint import CheckpointError
from jaxsim.rl.runs import directory

RUN = {"env": "fast", "algorithm": "ppo", "seed": 0, "settings": config.plain(ppo.Config())}


def test_a_directory_is_held_by_one_run(tmp_path):
    with (
        directory.hold(tmp_path, resume=False),
        pytest.raises(CheckpointError, match="is in use by another run"),
        directory.hold(tmp_path, resume=True),
    ):
        pass
    with directory.hold(tmp_path, resume=False):
        pass


def test_a_place_that_cannot_be_written_to_is_told_before_anything_is_compiled(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CheckpointError, match="cannot write to .*file/run: Not a directory"):
        train("fast", directory=tmp_path / "file" / "run")
    with pytest.raises(CheckpointError, match="cannot write to .*file: File exists"):
        train("fast", directory=tmp_path / "file")


def test_a_disk_without_room_for_checkpoints_is_told_first(tmp_path, monkeypatch):
    full = SimpleNamespace(total=1e9, used=1e9, free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: full)
    with pytest.raises(CheckpointError, match=r"has 0 MB left, the checkpoints .* need 3 MB"):
        train("fast", directory=tmp_path / "run")


@pytest.mark.usefixtures("compiled_once")
def test_a_disk_that_fills_up_is_told(tiny, tmp_path, monkeypatch):
    def full(self, row):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(metrics.Logs, "write", full)
    with pytest.raises(CheckpointError, match="cannot write to .*: No space left on device"):
        train("fast", settings=tiny, directory=tmp_path / "run")


def test_what_was_only_begun_may_be_begun_again(tmp_path):
    """A training that fails while it is compiled leaves nothing that could get lost."""
    directory.write_run(tmp_path, RUN)
    with directory.hold(tmp_path, resume=False):
        pass
    (tmp_path / "metrics.jsonl").write_text("")
    with (
        pytest.raises(CheckpointError, match="holds a run already; resume it, or choose"),
        directory.hold(tmp_path, resume=False),
    ):
        pass


def test_what_is_written_is_read(tmp_path):
    directory.write_run(tmp_path, RUN)
    assert directory.read_run(tmp_path) == RUN
    with pytest.raises(config.ConfigError, match="must be plain numbers and words"):
        directory.write_run(tmp_path, RUN | {"settings": {"env_options": {"model": object()}}})
    assert directory.read_run(tmp_path) == RUN


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "must contain a mapping of settings, got None"),
        (b"a: [", "run.yaml is not valid YAML"),
        (b"\xff", "run.yaml is not valid YAML"),
        (b"[1, 2]", r"must contain a mapping of settings, got \[1, 2\]"),
        (b"env: hopper\n", "its entry 'algorithm' is nothing"),
        (b"env: hopper\nalgorithm: ppo\nseed: 0\nsettings: 3\n", "its entry 'settings' is 3"),
        (b"env: [1]\nalgorithm: ppo\nseed: 0\nsettings: {}\n", r"its entry 'env' is \[1\]"),
    ],
)
def test_a_damaged_run_is_one_error_that_names_the_file(tmp_path, content, message):
    (tmp_path / "run.yaml").write_bytes(content)
    with pytest.raises(CheckpointError, match=message) as found:
        directory.read_run(tmp_path)
    assert "damaged" in str(found.value)
    assert "run.yaml" in str(found.value)
