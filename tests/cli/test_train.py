"""`jaxsim train` and `jaxsim play`: what they write, what they say, and how they fail."""

import importlib.util

import pytest

from jaxsim.cli import main

SETTINGS = """
total_steps: 256
envs: 8
unroll: 16
minibatches: 2
passes: 1
evaluations: 2
evaluation_episodes: 4
"""


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "settings.yaml"
    path.write_text(SETTINGS)
    return path


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def test_train_resume_play(config, tmp_path, capsys):
    out = tmp_path / "run"
    assert run("train", "fast", "--config", config, "--out", out, "--no-video") == 0
    told = capsys.readouterr()
    assert "return of the policy" in told.out
    assert "learning curve: " in told.err
    if importlib.util.find_spec("matplotlib"):
        assert (out / "curve.png").read_bytes().startswith(b"\x89PNG")
    else:
        assert "pip install matplotlib" in told.err
    for name in ("run.yaml", "metrics.jsonl", "checkpoints"):
        assert (out / name).exists()
    assert (out / "tensorboard").exists() == bool(importlib.util.find_spec("tensorboardX"))

    more = ("--set", "total_steps=384", "--set", "evaluations=3")
    assert run("train", "fast", "--resume", out, "--no-video", *more) == 0
    assert len((out / "metrics.jsonl").read_text("utf-8").splitlines()) == 3
    capsys.readouterr()

    assert run("play", out, "--episodes", 5, "--no-video") == 0
    report = capsys.readouterr().out
    assert "fast, trained by ppo" in report
    assert "20.0 steps" in report

    assert run("train", "fast", "--resume", out, "--no-video") == 0
    told = capsys.readouterr()
    assert "has come to its end, and nothing was changed" in told.err
    assert not told.out

    assert run("train", "reacher", "--resume", out) == 2
    assert "is about fast, not reacher" in capsys.readouterr().err
    assert run("train", "fast", "--out", out) == 2
    assert "holds a run already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("train", "fasst"), "there is no environment called 'fasst'; did you mean fast"),
        (("train", "fast", "--algorithm", "pppo"), "did you mean ppo"),
        (("train", "fast", "--set", "learning_rat=1"), "did you mean learning_rate"),
        (("train", "fast", "--set", "env_options={frame_skp: 1}"), "did you mean frame_skip"),
        (("train", "fast", "--config", "nowhere.yaml"), "cannot read nowhere.yaml"),
        (("train", "fast", "--resume", "nowhere"), "nowhere is not the directory of a run"),
        (("play", "nowhere"), "nowhere is not the directory of a run"),
    ],
)
def test_mistakes_are_told_in_one_sentence(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run(*arguments) == 2
    told = capsys.readouterr().err
    assert told.startswith("jaxsim: ")
    assert message in told
    assert "Traceback" not in told
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["train", "play"])
def test_help_teaches(command, capsys):
    with pytest.raises(SystemExit):
        run(command, "--help")
    assert f"  jaxsim {command} " in capsys.readouterr().out
