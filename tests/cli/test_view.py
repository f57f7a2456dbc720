"""`jaxsim view`: recordings become pages, and what cannot be shown is told in a sentence."""

import mujoco

from jaxsim.cli import main
from jaxsim.viz import save_trajectory


def test_a_recording_becomes_a_page(tmp_path, capsys):
    import jax
    import numpy as np

    import jaxsim

    model = jaxsim.load("pendulum")
    state = jaxsim.make_state(model)
    states = jax.tree.map(lambda x: np.stack([np.asarray(x)] * 2), state)
    path = save_trajectory(tmp_path / "run", model, states)
    assert main(["view", str(path), "--no-open"]) == 0
    assert (tmp_path / "run.html").read_text().startswith("<!doctype html>")
    assert "run.html" in capsys.readouterr().err
    assert mujoco.__version__


def test_mistakes_are_told_in_a_sentence(tmp_path, capsys):
    (tmp_path / "bad.npz").write_bytes(b"no")
    for what in ("no_such_model", tmp_path, tmp_path / "bad.npz", tmp_path / "none.npz"):
        assert main(["view", str(what), "--no-open"]) == 2
        assert capsys.readouterr().err.startswith("jaxsim: ")
