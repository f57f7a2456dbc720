"""`jaxsim inspect`: contents, budgets, refusals."""

from jaxsim.cli import main

REFUSED = """
<mujoco>
  <worldbody><body><joint name="hinge"/><geom size=".1"/></body></worldbody>
  <actuator><general name="mine" joint="hinge" dyntype="user"/></actuator>
</mujoco>
"""


def test_what_a_model_has(capsys):
    assert main(["inspect", "humanoid"]) == 0
    out = capsys.readouterr().out
    assert "nq 24, nv 23, nu 17, na 0" in out
    assert "18 joint" in out
    assert "capsule-capsule" in out
    assert "of condim 3" in out


def test_speed_of_a_batch_beside_mujoco(capsys):
    assert main(["inspect", "pendulum", "--speed", "--envs", "8"]) == 0
    out = capsys.readouterr().out
    for name in ("compile time", "memory of a step", "steps per second", "of MuJoCo C"):
        assert name in out


def test_refusals_are_listed(tmp_path, capsys):
    file = tmp_path / "refused.xml"
    file.write_text(REFUSED)
    assert main(["inspect", str(file)]) == 1
    found = capsys.readouterr()
    assert "1 joint" in found.out
    assert "actuator 'mine': dyntype 'user' is not supported" in found.err


def test_a_file_that_is_no_model(tmp_path, capsys):
    file = tmp_path / "nothing.xml"
    file.write_text("<robot")
    assert main(["inspect", str(file)]) == 2
    assert "jaxsim:" in capsys.readouterr().err
