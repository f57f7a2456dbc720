"""Parser for the docstrings and fields of environments' classes.

Docstrings of environments have paragraphs that begin `Observation (11,)`, `Action (3,)`,
`Reward:`, `Episode:`, and `Gymnasium:`, `Brax:` or `Differences from`; `Attributes:` describes
the options.
"""

import dataclasses
import inspect
import re
from typing import Any

from jaxsim.envs.base.env import Env, Task

_LABELS = "Observation|Action|Reward|Episode|Gymnasium|Brax|Differences from"
_PARAGRAPH = re.compile(rf"^({_LABELS})\b(?: \((\d+),\))?(.*)", re.DOTALL)


@dataclasses.dataclass(frozen=True)
class Option:
    """A field of an environment: an argument of `make`.

    Attributes:
      name: name of the field.
      default: its default; None if a function makes it.
      meaning: its description in the docstring.
    """

    name: str
    default: Any
    meaning: str


@dataclasses.dataclass(frozen=True)
class Description:
    """The documentation of an environment.

    Attributes:
      summary: the first sentence.
      sizes: lengths of observation and action, as far as they are documented.
      sections: text by label, in the order of the docstring.
      options: the fields.
    """

    summary: str
    sizes: dict[str, int]
    sections: dict[str, str]
    options: tuple[Option, ...]


def describe(cls: type[Env]) -> Description:
    """Parse the documentation of an environment's class."""
    doc = inspect.getdoc(cls) or ""
    summary, _, rest = doc.partition("\n\n")
    body = re.split(r"^Attributes:$", rest, maxsplit=1, flags=re.MULTILINE)[0]
    sizes: dict[str, int] = {}
    sections: dict[str, str] = {}
    label = ""
    for paragraph in re.split(r"\n\s*\n", body.strip()):
        found = _PARAGRAPH.match(paragraph)
        if found:
            label, size, text = found.groups()
            sizes |= {label.lower(): int(size)} if size else {}
            paragraph = paragraph if label.startswith("Diff") else text.lstrip(":, \n")
        if paragraph.strip():
            sections[label] = "\n\n".join(x for x in (sections.get(label), paragraph) if x)
    return Description(" ".join(summary.split()), sizes, sections, _options(cls))


def _options(cls: type[Env]) -> tuple[Option, ...]:
    meanings = {}
    for ancestor in reversed((*cls.__mro__, Task)):
        meanings |= _attributes(ancestor)
    fields = dataclasses.fields(cls)  # pyright: ignore[reportArgumentType]
    return tuple(
        Option(
            field.name,
            None if field.default is dataclasses.MISSING else field.default,
            meanings.get(field.name, ""),
        )
        for field in fields
    )


def _attributes(cls: type) -> dict[str, str]:
    """Names and meanings under `Attributes:` in a class's own docstring."""
    doc = inspect.cleandoc(cls.__dict__.get("__doc__") or "")
    parts = re.split(r"^Attributes:$", doc, maxsplit=1, flags=re.MULTILINE)
    entries = re.findall(
        r"^  (\w+): (.*(?:\n    .*)*)", parts[1] if parts[1:] else "", re.MULTILINE
    )
    return {name: " ".join(text.split()) for name, text in entries}
