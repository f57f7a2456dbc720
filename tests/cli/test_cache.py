"""Compiled programs for the next time: where they are, and when there are none."""

import os
import pathlib
import sys

import jax
import pytest

import jaxsim
from jaxsim.cli import cache, main


@pytest.fixture(autouse=True)
def unchanged():
    """What the cache changes of JAX is changed back."""
    names = "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs"
    before = {name: getattr(jax.config, name) for name in names}
    jax.config.update(names[0], None)
    yield
    for name, value in before.items():
        jax.config.update(name, value)


@pytest.mark.parametrize(
    ("platform", "variables", "expected"),
    [
        ("linux", {"XDG_CACHE_HOME": "/x"}, "/x/jaxsim"),
        ("linux", {"HOME": "/users/me"}, "/users/me/.cache/jaxsim"),
        ("darwin", {"HOME": "/users/me"}, "/users/me/Library/Caches/jaxsim"),
        ("win32", {"LOCALAPPDATA": "/data"}, "/data/jaxsim"),
        ("linux", {"JAXSIM_CACHE": "/mine", "XDG_CACHE_HOME": "/x"}, "/mine"),
        ("linux", {"JAXSIM_CACHE": ""}, None),
    ],
)
def test_the_directory_is_the_platforms(monkeypatch, platform, variables, expected):
    for name in ("JAXSIM_CACHE", "XDG_CACHE_HOME", "LOCALAPPDATA"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(cache.sys, "platform", platform)
    assert cache.directory() == (None if expected is None else pathlib.Path(expected))


def test_it_is_asked_for_and_can_be_turned_off(monkeypatch, tmp_path):
    monkeypatch.setenv("JAXSIM_CACHE", str(tmp_path))
    folder = cache.enable()
    assert folder.parent == tmp_path
    assert jax.config.jax_compilation_cache_dir == str(folder)
    jax.config.update("jax_compilation_cache_dir", "/of/the/user")
    assert cache.enable() is None
    assert jax.config.jax_compilation_cache_dir == "/of/the/user"
    jax.config.update("jax_compilation_cache_dir", None)
    monkeypatch.setenv("JAXSIM_CACHE", "")
    assert cache.enable() is None
    assert jax.config.jax_compilation_cache_dir is None


def test_a_place_that_cannot_be_written_to_is_no_reason_to_stop(monkeypatch, tmp_path):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("JAXSIM_CACHE", str(tmp_path / "file"))
    assert cache.enable() is None


def test_the_oldest_programs_go_first(monkeypatch, tmp_path):
    for age, name in enumerate("abc"):
        (tmp_path / name).write_bytes(bytes(10))
        os.utime(tmp_path / name, (1000 - age, 1000 - age))
    monkeypatch.setattr(cache, "LARGEST", 15)
    cache._prune(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_alone_it_shows_what_one_can_do(capsys):
    assert main([]) == 0
    told = capsys.readouterr().out
    assert "jaxsim train inverted_pendulum" in told
    with pytest.raises(SystemExit, match="0"):
        main(["--version"])
    assert capsys.readouterr().out == f"jaxsim {jaxsim.__version__}\n"


def test_modules_of_the_present_directory_come_last_and_only_if_named(monkeypatch):
    before = [place for place in sys.path if place]
    monkeypatch.setattr(sys, "path", list(before))
    assert main(["envs"]) == 0
    assert sys.path == before
    assert main(["train", "no_such_module:Task"]) == 2
    assert sys.path == [*before, ""]
