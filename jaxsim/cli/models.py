"""`jaxsim models`: the models that come with the package."""

import argparse
import re

import mujoco

from jaxsim.cli.report import listing
from jaxsim.io import bundled_models, bundled_xml


def run(_: argparse.Namespace) -> int:
    """Print one line for each bundled model: its name, its sizes and a description."""
    listing("model", ("nq", "nv", "nu"), "what it is", map(_row, bundled_models()))
    return 0


def _row(name: str) -> tuple[str, int, int, int, str]:
    xml = bundled_xml(name)
    model = mujoco.MjModel.from_xml_string(xml)
    return name, model.nq, model.nv, model.nu, _header(xml)


def _header(xml: str) -> str:
    """The comment at the top of a model file."""
    comment = re.match(r"<!--(.*?)-->", xml, re.DOTALL)
    return " ".join(comment[1].split()) if comment else ""
