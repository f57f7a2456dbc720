"""`jaxsim simulate` and `jaxsim models`: what they print, and how they fail."""

import subprocess
import sys

import jax
import numpy as np
import pytest

import jaxsim
from jaxsim.cli import main
from jaxsim.cli.simulate import initial_states

FALLING = """
<mujoco><worldbody><body><freejoint/><geom size="0.1" mass="2"/></body></worldbody></mujoco>
"""

UNSTABLE = """
<mujoco>
  <option timestep="0.02"><flag eulerdamp="disable"/></option>
  <worldbody>
    <body><joint type="slide" stiffness="1e9"/><geom size="0.1" mass="1"/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture
def falling(tmp_path):
    path = tmp_path / "falling.xml"
    path.write_text(FALLING)
    return str(path)


def run(*arguments: object) -> int:
    return main([str(argument) for argument in arguments])


def test_report_names_what_was_run(capsys):
    assert run("simulate", "pendulum", "--envs", 6, "--steps", 25, "--chunk", 10) == 0
    report = capsys.readouterr().out
    assert "pendulum (nq 1, nv 1, nu 1)" in report
    assert "6 on 2 cpu device(s)" in report
    assert "25 of 0.05 s" in report
    assert "steps per second" in report
    assert "compile time" in report


def test_free_fall_has_the_energy_of_free_fall(falling, capsys):
    """After t = 0.5 s a mass of 2 kg has 1/2 m (g t)^2 = 24.06 J; the seeded noise adds little."""
    assert run("simulate", falling, "--envs", 3, "--steps", 50, "--timestep", 0.01) == 0
    report = capsys.readouterr().out
    line = next(x for x in report.splitlines() if "mean kinetic energy" in x)
    assert float(line.split()[-2]) == pytest.approx(0.5 * 2 * (9.81 * 0.5) ** 2, rel=0.02)
    assert "3 on 1 cpu device(s)" in report  # two devices cannot share three environments


def test_seed_decides_the_initial_velocities():
    state = jaxsim.make_state(jaxsim.load("acrobot"))
    mesh = jax.sharding.Mesh(jax.devices()[:1], ("batch",))

    def velocities(seed: int):
        states, _ = initial_states(state, envs=4, seed=seed, mesh=mesh)
        return np.asarray(states.qvel)

    np.testing.assert_array_equal(velocities(1), velocities(1))
    assert len(np.unique(np.concatenate([velocities(1), velocities(2)]))) == 16


def test_divergence_is_counted_and_comes_with_a_remedy(tmp_path, capsys):
    path = tmp_path / "unstable.xml"
    path.write_text(UNSTABLE)
    assert run("simulate", path, "--envs", 2, "--steps", 60, "--chunk", 20) == 1
    captured = capsys.readouterr()
    assert "2 of 2 environments diverged" in captured.err
    assert "--timestep 0.01" in captured.err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["simulate", "humanoidd"], "humanoid"),
        (["simulate", "no_such_robot.xml"], "no_such_robot.xml"),
        (["simulate", "box_on_plane", "--keyframe", "slied"], "slide"),
    ],
)
def test_mistake_is_one_sentence_with_what_would_work(arguments, message, capsys):
    assert run(*arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error
    assert error.startswith("jaxsim: ")
    assert len(error.splitlines()) == 1


def test_broken_file_is_a_mistake_and_not_a_traceback(tmp_path, capsys):
    path = tmp_path / "broken.xml"
    path.write_text("<mujoco><worldbody><bodi/></worldbody></mujoco>")
    assert run("simulate", path) == 2
    assert "bodi" in capsys.readouterr().err


@pytest.mark.parametrize("flags", [["--envs", "0"], ["--steps", "-3"], ["--ctrl", "wild"]])
def test_impossible_options_are_refused(flags, capsys):
    with pytest.raises(SystemExit) as caught:
        run("simulate", "pendulum", *flags)
    assert caught.value.code == 2
    assert flags[0] in capsys.readouterr().err


def test_models_lists_every_bundled_model(capsys):
    assert run("models") == 0
    listing = capsys.readouterr().out
    assert all(name in listing for name in ("pendulum", "humanoid", "four_bar", "quadruped"))


def test_help_teaches_by_example(capsys):
    with pytest.raises(SystemExit):
        run("simulate", "--help")
    assert "jaxsim simulate humanoid" in capsys.readouterr().out


def test_command_works_in_a_process_of_its_own():
    done = subprocess.run(
        [sys.executable, "-m", "jaxsim", "models"], capture_output=True, text=True, timeout=120
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "quadruped" in done.stdout
