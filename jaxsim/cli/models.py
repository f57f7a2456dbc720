"""`jaxsim models`: the models that come with the package."""

import argparse
import re
from importlib import resources

import mujoco
import rich
import rich.table

from jaxsim.io import bundled_models


def run(_: argparse.Namespace) -> int:
    """Print one line per bundled model: its name, its sizes and what it is."""
    table = rich.table.Table(box=None)
    table.add_column("model", no_wrap=True)
    for size in ("nq", "nv", "nu"):
        table.add_column(size, justify="right")
    table.add_column("what it is")
    for name in bundled_models():
        xml = (resources.files("jaxsim") / "assets" / f"{name}.xml").read_text("utf-8")
        model = mujoco.MjModel.from_xml_string(xml)
        table.add_row(name, *(str(n) for n in (model.nq, model.nv, model.nu)), _header(xml))
    rich.print(table)
    return 0


def _header(xml: str) -> str:
    """The comment at the top of a model file."""
    comment = re.match(r"<!--(.*?)-->", xml, re.DOTALL)
    return " ".join(comment[1].split()) if comment else ""
