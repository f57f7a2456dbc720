"""Runs of somebody else: what they name is followed only to code that the reader names."""

import sys

import pytest

from jaxsim.envs import TimeLimit
from jaxsim.rl.checkpoint import CheckpointError
from jaxsim.rl.runs.stored import run_env, stored_settings

RUN = {"env": "fast", "algorithm": "ppo", "seed": 0, "settings": {}}


@pytest.fixture
def payload(tmp_path, monkeypatch):
    """A module that would say so if it were imported."""
    (tmp_path / "some_payload.py").write_text("raise RuntimeError('code ran')\n")
    monkeypatch.syspath_prepend(tmp_path)
    return "some_payload:X"


def test_code_is_not_imported_on_the_word_of_a_run(payload):
    with pytest.raises(CheckpointError, match="env of this run is 'some_payload:X', code that"):
        run_env(RUN | {"env": payload})
    with pytest.raises(CheckpointError, match="algorithm of this run is 'some_payload:X', code"):
        stored_settings(RUN | {"algorithm": payload})
    assert "some_payload" not in sys.modules


def test_code_is_imported_where_run_and_reader_agree(payload):
    with pytest.raises(RuntimeError, match="code ran"):
        run_env(RUN | {"env": payload}, payload)
    with pytest.raises(CheckpointError, match="env of this run is 'fast', not 'some_payload:X'"):
        run_env(RUN, payload)
    env = run_env(RUN | {"env": "jaxsim.envs.fast:Fast"}, "jaxsim.envs.fast:Fast")
    assert isinstance(env, TimeLimit)


def test_settings_that_are_none_of_the_algorithm():
    with pytest.raises(CheckpointError, match="settings of this run are damaged: unknown setting"):
        stored_settings(RUN | {"settings": {"learning_rat": 1}})
