"""Writes `docs/envs/*.md`, one page per environment, from the docstrings and the fields.

Run `python docs/generate_envs.py` after changing an environment; a test compares.
"""

import pathlib

import jaxsim.envs
from jaxsim.envs.bridges import gymnasium_id
from jaxsim.envs.registry.describe import Description, Option, describe

FOLDER = pathlib.Path(__file__).parent / "envs"
NOTE = "<!-- Written by docs/generate_envs.py from jaxsim/envs/{name}.py; change it there. -->"
DIFFERENCES = ("Gymnasium", "Brax", "Differences from")
INDEX = """\
# Environments

{note}

Made by `jaxsim.envs.make("ant")`; options are the fields that the pages list, for instance
`make("ant", reset_noise_scale=0.0)`. Units are SI. Tasks with the names of Gymnasium's have their
v5 models, observations, rewards, terminations and resets; each page says where it differs.

| name | observation | action | steps | task |
| --- | ---: | ---: | ---: | --- |
{rows}

An environment of your own: [own_environment.md](../own_environment.md). In Gymnasium,
Stable-Baselines3, Brax or torch: [bridges.md](../bridges.md).
"""


def pages() -> dict[str, str]:
    """File names and contents of all pages."""
    bundled = [n for n in jaxsim.envs.names() if isinstance(jaxsim.envs.spec(n).cls, str)]
    found = {name: describe(jaxsim.envs.spec(name).load()) for name in bundled}
    texts = {f"{name}.md": _page(name, description) for name, description in found.items()}
    return {"README.md": _index(found), **texts}


def _index(found: dict[str, Description]) -> str:
    rows = [
        f"| [{name}]({name}.md) | {d.sizes['observation']} | {d.sizes['action']} "
        f"| {jaxsim.envs.spec(name).max_episode_steps} | {d.summary} |"
        for name, d in found.items()
    ]
    return INDEX.format(note=NOTE.format(name="*"), rows="\n".join(rows))


def _page(name: str, description: Description) -> str:
    sections, sizes = dict(description.sections), description.sizes
    blocks = [f"# {name}", NOTE.format(name=name), description.summary, sections.pop("", "")]
    blocks.append(_facts(name))
    for label in ("Observation", "Action", "Reward", "Episode"):
        size = f" ({sizes[label.lower()]},)" if label.lower() in sizes else ""
        blocks += [f"## {label}{size}", _sentence(sections.pop(label))]
    blocks.append("## Differences from Gymnasium and Brax")
    for label in DIFFERENCES:
        if label in sections:
            name_it = "" if label.startswith("Diff") else f"**{label}**: "
            blocks.append(name_it + sections.pop(label))
    assert not sections, f"{name}: no place for {list(sections)}"
    blocks += ["## Options", "\n".join(_option_rows(name, description.options))]
    return "\n\n".join(block for block in blocks if block) + "\n"


def _facts(name: str) -> str:
    spec = jaxsim.envs.spec(name)
    env = spec.load()()
    low, high = env.action_low, env.action_high
    bounds = sorted({(float(a), float(b)) for a, b in zip(low, high, strict=True)})
    rows = {
        "in Python": f'`jaxsim.envs.make("{name}")`',
        "in Gymnasium": f'`gymnasium.make("{gymnasium_id(name)}")`',
        "actions within": ", ".join(f"({a:g}, {b:g})" for a, b in bounds),
        "time step": f"{float(env.model.opt.timestep):g} s, {env.frame_skip} for each action",
        "episode": f"{spec.max_episode_steps} steps, {_seconds(spec.max_episode_steps, env)} s",
    }
    return "\n".join(["| | |", "| --- | --- |", *(f"| {k} | {v} |" for k, v in rows.items())])


def _seconds(steps: int, env) -> str:
    return f"{round(steps * float(env.dt), 6):g}"


def _option_rows(name: str, options: tuple[Option, ...]):
    yield from ("| name | default | meaning |", "| --- | --- | --- |")
    for option in options:
        assert option.meaning, f"{name}: {option.name} is not described under Attributes"
        file = f"`jaxsim/assets/{name}.xml`"
        default = file if option.name == "model" else f"`{option.default}`"
        yield f"| `{option.name}` | {default} | {option.meaning.rstrip('.')} |"


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]


def main() -> None:
    """Write the pages, remove those of environments that are gone."""
    FOLDER.mkdir(exist_ok=True)
    written = pages()
    for old in FOLDER.glob("*.md"):
        if old.name not in written:
            old.unlink()
    for file, text in written.items():
        (FOLDER / file).write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
