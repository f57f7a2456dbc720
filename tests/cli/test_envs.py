"""`jaxsim envs`: a line for every environment."""

import jaxsim.envs
from jaxsim.cli import main


def test_lists_every_environment(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    assert main(["envs"]) == 0
    lines = capsys.readouterr().out.splitlines()
    shown = {line.split()[0]: line.split()[1:] for line in lines if line.strip()}
    assert set(jaxsim.envs.names()) <= set(shown)
    assert shown["half_cheetah"][:3] == ["17", "6", "1000"]
    assert shown["fast"][:3] == ["1", "1", "20"]
    assert "hops forward" in " ".join(shown["hopper"])
