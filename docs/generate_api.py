"""Writes `docs/api.md`, the index of public names, from `__all__` and the docstrings.

Run `python docs/generate_api.py` after adding a public name; a test compares.
"""

import importlib
import inspect
import pathlib
import re

PAGE = pathlib.Path(__file__).parent / "api.md"
PACKAGES = (
    "jaxsim",
    "jaxsim.model",
    "jaxsim.io",
    "jaxsim.envs",
    "jaxsim.envs.wrappers",
    "jaxsim.envs.bridges",
    "jaxsim.rl",
    "jaxsim.gradients",
    "jaxsim.sysid",
    "jaxsim.trajopt",
    "jaxsim.viz",
    "jaxsim.spatial",
)
# Names without a docstring of their own.
CONSTANTS = {"ALGORITHMS": "Names of the trainers that come with jaxsim, and their classes."}
HEAD = """\
# Public names

<!-- Written by docs/generate_api.py from the docstrings; change them there. -->

`help` shows each in full. A name that is listed in a package above is not listed again below.
Everything else in the package may change; [architecture.md](architecture.md) says where it is.
"""
KINDS = ("Functions", "Classes", "Errors", "Constants")


def page() -> str:
    """The text of the page."""
    parts = [HEAD]
    for name, new in new_names().items():
        package = importlib.import_module(name)
        summary = f"{_summary(package)} [Examples](examples/{name}.md)."
        parts.append(f"## `{name}`\n\n{summary}\n")
        parts += [_table(kind, package, new) for kind in KINDS]
    return "\n".join(part for part in parts if part)


def new_names() -> dict[str, list[str]]:
    """For each package, its public names that no package above it has."""
    listed, found = set(), {}
    for name in PACKAGES:
        package = importlib.import_module(name)
        found[name] = [n for n in package.__all__ if id(getattr(package, n)) not in listed]
        listed |= {id(getattr(package, n)) for n in found[name]}
    return found


def _table(kind: str, package, names: list[str]) -> str:
    rows = [
        f"| `{name}{_signature(thing)}` | {CONSTANTS.get(name) or _summary(thing)} |"
        for name in sorted(names, key=str.lower)
        if _kind(thing := getattr(package, name)) == kind
    ]
    return "\n".join([f"| {kind} | |", "| --- | --- |", *rows, ""]) if rows else ""


def _kind(thing) -> str:
    if not inspect.isclass(thing):
        return "Functions" if callable(thing) else "Constants"
    return "Errors" if issubclass(thing, Exception) else "Classes"


def _signature(thing) -> str:
    """Names of a function's arguments; those with a default have `=`."""
    if _kind(thing) != "Functions":
        return ""
    marks = {inspect.Parameter.VAR_KEYWORD: "**", inspect.Parameter.VAR_POSITIONAL: "*"}
    given = inspect.signature(thing).parameters.values()
    empty = inspect.Parameter.empty
    names = [marks.get(p.kind, "") + p.name + "=" * (p.default is not empty) for p in given]
    return f"({', '.join(names)})"


def _summary(thing) -> str:
    """The first paragraph of a docstring, as one line of a table."""
    text = re.sub(":func:|`(?=`)", "", inspect.getdoc(thing) or "")  # Markdown's way to mark code
    return " ".join(text.split("\n\n")[0].split()).replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
