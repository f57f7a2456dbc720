"""Text reaches the terminal as it is."""

from jaxsim.cli.report import note, report


def test_brackets_stand_for_themselves(capsys):
    note("install jaxsim-physics[viz], [red]or[/red] not")
    report({"directory": "runs/[bold]/a", "return": "1.0"})
    told = capsys.readouterr()
    assert told.err == "install jaxsim-physics[viz], [red]or[/red] not\n"
    assert "runs/[bold]/a" in told.out
