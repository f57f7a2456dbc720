"""`jaxsim envs`: a line for every environment."""

import jaxsim.envs
from jaxsim.cli import main


def test_lists_every_environment(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    assert main(["envs"]) == 0
    out = capsys.readouterr().out
    rows = [line.split() for line in out.splitlines() if line.strip()]
    # Descriptions may go on in lines of their own, which have no numbers.
    shown = {words[0]: words[1:] for words in rows if words[1:] and words[1].isdigit()}
    assert set(jaxsim.envs.names()) <= set(shown)
    assert shown["half_cheetah"][:3] == ["17", "6", "1000"]
    assert shown["fast"][:3] == ["1", "1", "20"]
    assert "hops forward" in " ".join(out.split())
