"""What MkDocs does not do by itself: notebooks from outside of here, pages of the reference."""

import importlib.util
import pathlib
import re

from mkdocs.plugins import event_priority
from mkdocs.structure.files import File, Files

ROOT = pathlib.Path(__file__).parents[1]
REPOSITORY = {"configs", "benchmarks", "notebooks", "tests", "examples", "jaxsim"}


def on_config(config):
    """List notebooks, environments and packages in the navigation."""
    lists = {
        "notebooks": [f"notebooks/{path.name}" for path in _notebooks()],
        "envs": [f"envs/{p.name}" for p in sorted((ROOT / "docs" / "envs").glob("*.md"))],
        "reference": ["api.md", *(f"reference/{name}.md" for name in _packages())],
    }
    config["nav"] = [
        {title: lists.get(pages, pages) if isinstance(pages, str) else pages}
        for entry in config["nav"]
        for title, pages in entry.items()
    ]
    return config


@event_priority(100)  # before the plugin that makes pages of notebooks
def on_files(files: Files, config) -> Files:
    """Add notebooks, and pages that mkdocstrings fills."""
    for path in _notebooks():
        place = str(path.relative_to(ROOT))
        files.append(File(place, str(ROOT), config["site_dir"], config["use_directory_urls"]))
    for name in _packages():
        files.append(File.generated(config, f"reference/{name}.md", content=_reference(name)))
    return files


def on_page_markdown(markdown: str, **_) -> str:
    """Links to files of the repository that are no pages become their names.

    Examples are on the pages of the reference.
    """
    markdown = re.sub(r"\(examples/([\w.]+\.md)\)", r"(reference/\1#examples)", markdown)
    return re.sub(r"\[([^\]]*)\]\(\.\./(\w+)[^)]*\)", _named, markdown)


def _named(found: re.Match) -> str:
    return found[1] if found[2] in REPOSITORY else found[0]


def _notebooks() -> list[pathlib.Path]:
    return sorted((ROOT / "notebooks").glob("*.ipynb"))


def _packages() -> tuple[str, ...]:
    spec = importlib.util.spec_from_file_location("generate_api", ROOT / "docs/generate_api.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module.PACKAGES


def _reference(name: str) -> str:
    """Documentation of the names that a package exports."""
    package = importlib.import_module(name)
    listed = sorted(package.__all__, key=str.lower)
    examples = (ROOT / "docs" / "examples" / f"{name}.md").read_text("utf-8")
    head = f"# `{name}`\n\n## Examples\n\n{examples}\n## Names\n\n::: {name}\n"
    return f"{head}    options:\n      show_root_heading: false\n      members: {listed}\n"
