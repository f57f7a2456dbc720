"""The documentation's table of sensors says what the code does."""

import pathlib

import mujoco

from jaxsim.sensor import SENSORS

PAGE = pathlib.Path(__file__).parents[2] / "docs" / "sensors.md"


def _table() -> dict[str, str]:
    """Status by name of sensor."""
    rows = [line.split("|") for line in PAGE.read_text().splitlines() if line.startswith("| `")]
    return {cells[1].strip().strip("`"): cells[2].strip() for cells in rows}


def test_table_lists_every_type_once_in_order():
    names = [name.removeprefix("mjSENS_") for name in mujoco.mjtSensor.__members__]
    names.sort(key=lambda name: int(mujoco.mjtSensor.__members__[f"mjSENS_{name}"]))
    assert list(_table()) == names


def test_table_agrees_with_the_code():
    table = _table()
    assert {name for name, status in table.items() if status == "supported"} == set(SENSORS)
    assert set(table.values()) == {"supported", "unsupported"}
