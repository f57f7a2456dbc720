"""`jaxsim bench` runs the scripts of the repository."""

import pytest

from jaxsim.cli import bench, main


def test_options_go_to_the_benchmark(capfd):
    pytest.importorskip("matplotlib")
    assert main(["bench", "throughput", "--help"]) == 0
    assert "--peers" in capfd.readouterr().out


def test_an_installed_package_says_where_the_benchmarks_are(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bench, "FOLDER", tmp_path)
    assert main(["bench", "solver"]) == 2
    assert "clone the repository" in capsys.readouterr().err


def test_an_unknown_benchmark_names_the_others(capsys):
    with pytest.raises(SystemExit):
        main(["bench", "throughputt"])
    assert "throughput" in capsys.readouterr().err
