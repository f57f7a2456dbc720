"""`jaxsim envs`: a line for every environment."""

import jaxsim.envs
from jaxsim.cli import main


def test_lists_every_environment(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "160")
    assert main(["envs"]) == 0
    out = capsys.readouterr().out
    rows = [line.split() for line in out.splitlines() if line.strip()]
    # Descriptions may go on in lines of their own: a row begins with a name and the three sizes.
    names = jaxsim.envs.names()
    sized = lambda words: len(words) >= 4 and all(w.isdigit() or w == "-" for w in words[1:4])  # noqa: E731
    shown = {words[0]: words[1:] for words in rows if sized(words)}
    assert set(shown) == set(names)
    assert shown["half_cheetah"][:3] == ["17", "6", "1000"]
    assert shown["fast"][:3] == ["1", "1", "20"]
    assert "hops forward" in " ".join(out.split())
