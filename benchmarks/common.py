"""What all benchmarks share: devices, compilation, interleaved timing, machine, tables, results.

Absolute times drift on shared machines. Candidates are therefore timed in turn, repetition by
repetition, so that a disturbance meets all of them, and medians are reported with their spread.
"""

import argparse
import dataclasses
import datetime
import functools
import importlib.metadata
import json
import os
import pathlib
import platform
import shlex
import statistics
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Sequence

RESULTS = pathlib.Path(__file__).parent / "results"
XLA_FLAGS = os.environ.get("XLA_FLAGS", "")  # before `jaxsim.configure_cpu` adds its own


@dataclasses.dataclass
class Timing:
    """Seconds per call of one candidate: median, best, and half the interquartile range."""

    median: float
    best: float
    spread: float
    samples: list[float] = dataclasses.field(repr=False)

    @classmethod
    def of(cls, samples: Sequence[float]) -> "Timing":
        ordered = sorted(samples)
        quarter = len(ordered) // 4
        return cls(
            median=statistics.median(ordered),
            best=ordered[0],
            spread=(ordered[-1 - quarter] - ordered[quarter]) / 2,
            samples=list(samples),
        )

    def per(self, count: float) -> "Timing":
        """Seconds per item of calls that process `count` items."""
        return Timing.of([s / count for s in self.samples])


def interleave(
    candidates: dict[str, Callable[[], object]],
    repetitions: int,
    at_least: float = 0.02,
    clock: Callable[[], float] = time.perf_counter,
) -> dict[str, Timing]:
    """Time all candidates in turn, `repetitions` times.

    Args:
      candidates: functions that return after the work is done; the first call warms up.
      repetitions: samples for each of them.
      at_least: calls are repeated within a sample until it takes this long (s).
      clock: `time.process_time` on a machine that is busy with other things; for one thread only.
    """
    calls = {}
    for name, run in candidates.items():
        run()
        calls[name] = max(1, round(at_least / max(_seconds(run, 1, clock), 1e-9)))
    samples = {name: [] for name in candidates}
    for _ in range(repetitions):
        for name, run in candidates.items():
            samples[name].append(_seconds(run, calls[name], clock))
    return {name: Timing.of(values) for name, values in samples.items()}


def _seconds(run: Callable, calls: int, clock: Callable[[], float]) -> float:
    start = clock()
    for _ in range(calls):
        run()
    return (clock() - start) / calls


def setup(devices: int = 1, x64: bool = False) -> None:
    """Configure JAX; to be called before anything else touches it."""
    import jax

    import jaxsim

    jaxsim.configure_cpu(devices)
    jax.config.update("jax_enable_x64", x64)
    # A compilation that is found on disk would be reported as a fast one.
    jax.config.update("jax_enable_compilation_cache", False)


def in_chunks(f: Callable, lanes: int) -> Callable:
    """A function of one environment, for a batch in chunks of so many, as rollouts have them."""
    import jaxsim
    from jaxsim.parallel.chunks import map_chunks

    return functools.partial(map_chunks, jaxsim.vmap(f), lanes)


def compile_for(f: Callable, *args):
    """Compile a function for its arguments.

    Returns:
      A function without arguments that runs it and waits, the compiled program, and the seconds
      that tracing and compiling took.
    """
    import jax

    from jaxsim.parallel.devices import compiled

    start = time.perf_counter()
    program = compiled(f, jax.default_backend()).lower(*args).compile()
    seconds = time.perf_counter() - start
    return (lambda: jax.block_until_ready(program(*args))), program, seconds


def parser(description: str, repetitions: int) -> argparse.ArgumentParser:
    """Options that all benchmarks have."""
    options = argparse.ArgumentParser(description=description)
    options.add_argument("--repetitions", type=int, default=repetitions, help="interleaved samples")
    options.add_argument("--name", help="name of the files to write (default: that of the script)")
    options.add_argument(
        "--out", type=pathlib.Path, default=RESULTS, help="where results are written"
    )
    options.add_argument(
        "--cpu-time",
        dest="clock",
        action="store_const",
        const=time.process_time,
        default=time.perf_counter,
        help="count the time of this process only, on a busy machine (one thread)",
    )
    options.add_argument("--dry", action="store_true", help="print, but write no files")
    return options


def machine() -> dict:
    """What the numbers depend on besides the code."""
    import jax

    versions = ("jax", "jaxlib", "mujoco", "numpy")
    return {
        "cpu": _cpu_name(),
        "cores": os.cpu_count(),
        "load": round(os.getloadavg()[0], 2),
        "device": jax.devices()[0].device_kind,
        "devices": len(jax.devices()),
        "python": platform.python_version(),
        "date": datetime.date.today().isoformat(),
    } | {name: importlib.metadata.version(name) for name in versions}


def _cpu_name() -> str:
    info = pathlib.Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def table(rows: Iterable[dict], columns: Sequence[str] | None = None) -> str:
    """Rows as aligned text; numbers with three significant digits."""
    rows = list(rows)
    columns = columns or list(dict.fromkeys(key for row in rows for key in row))
    cells = [list(columns)] + [[_text(row.get(c, "")) for c in columns] for row in rows]
    widths = [max(len(line[i]) for line in cells) for i in range(len(columns))]
    adjust = [str.ljust] + [str.rjust] * (len(columns) - 1)
    aligned = [[f(*cw) for f, *cw in zip(adjust, line, widths, strict=True)] for line in cells]
    return "\n".join("  ".join(line) for line in aligned)


def table_markdown(rows: Iterable[dict], columns: Sequence[str] | None = None) -> str:
    """Rows as a table of Markdown; numbers as in `table`."""
    rows = list(rows)
    columns = columns or list(dict.fromkeys(key for row in rows for key in row))
    lines = [columns, ["---"] + ["---:"] * (len(columns) - 1)]
    lines += [[_text(row.get(c, "")) for c in columns] for row in rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _text(value) -> str:
    if value is None:
        return ""
    if isinstance(value, int):
        return f"{value:,}"
    if not isinstance(value, float):
        return textwrap.shorten(str(value), 70)
    if value == 0 or 1e-2 <= abs(value) < 1e3:
        return f"{value:.3g}"
    return f"{value:,.0f}" if abs(value) >= 1e3 else f"{value:.1e}"


def write(
    options: argparse.Namespace, script: str, record: dict, draw: Callable | None = None
) -> None:
    """Write `NAME.json`, and `NAME.png` if there is something to draw.

    Args:
      options: of the command line.
      script: `__file__` of the benchmark.
      record: what was measured; the machine is added.
      draw: function of a matplotlib figure.
    """
    if options.dry:
        return
    target = options.out / (options.name or pathlib.Path(script).stem)
    target.parent.mkdir(parents=True, exist_ok=True)
    made = {"command": _command(script), "commit": _commit(), "machine": machine()}
    text = json.dumps({**made, **record}, indent=1, default=float)
    target.with_suffix(".json").write_text(text + "\n")
    if draw is not None:
        save_figure(target.with_suffix(".png"), draw)
    print(f"written to {target}.json")


def converge(mj) -> None:
    """Let MuJoCo's solvers and its search for contacts of convex shapes go on to the end."""
    mj.opt.tolerance, mj.opt.noslip_tolerance = 0, 0
    mj.opt.ccd_iterations, mj.opt.ccd_tolerance = 500, 1e-15


def quick_options(level: int) -> dict[str, bool | int]:
    """Options of XLA for programs that run a few times: a level of optimisation, fast compilation.

    The newer code generator compiles slowly, and not every JAX has a choice.
    """
    import jax

    plain = {"xla_backend_optimization_level": level}
    older = plain | {"xla_cpu_use_fusion_emitters": False}
    try:
        jax.jit(lambda x: x + 1, compiler_options=older)(1.0)
    except jax.errors.JaxRuntimeError:
        return plain
    return older


def _command(script: str) -> str:
    """What was typed to run the script, and the flags of XLA."""
    words = ["python", f"benchmarks/{pathlib.Path(script).name}", *sys.argv[1:]]
    return " ".join([*([f"XLA_FLAGS={XLA_FLAGS}"] if XLA_FLAGS else []), shlex.join(words)])


def _commit() -> str:
    """The commit that was measured; "+" marks changes that were not committed."""
    git = ["git", "-C", str(RESULTS), "describe", "--always", "--exclude=*", "--dirty=+"]
    try:
        return subprocess.run(git, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def save_figure(path: pathlib.Path, draw: Callable) -> None:
    """Draw without a display."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(9, 4), layout="constrained")
    draw(figure)
    figure.savefig(path, dpi=120)
    plt.close(figure)
