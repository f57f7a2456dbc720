"""Many steps under random and bang-bang controls: what goes wrong that does not in MuJoCo C.

Of each model a batch is simulated, half under uniformly random controls and half under ones that
jump between their limits, in calls of one compiled rollout. Counted are:

- diverged: environments whose numbers were not finite any more, and which began anew;
- alone: those of them that MuJoCo C simulates to the end of the call from where it began, with
  finite numbers and without a warning; there should be none;
- lost contacts: calls of environments in which contacts found no slot;
- growth of the process's memory and compilations after the first two calls; there should be none.

`--steps` is the number of all steps of all models together.
"""

import argparse
import dataclasses
import functools
import importlib.util
import pathlib
import time

import common
import mujoco
import numpy as np
from rich.progress import track

import jaxsim
from jaxsim.io import bundled_models, bundled_xml

LENGTH, HOLD = 50, 10  # steps of a call, and of a bang-bang control
WARM_UP = 2  # calls before memory and compilations are looked at
REPLAYED = 100  # so many diverged environments of a model are tried in MuJoCo C
WARNINGS = [int(getattr(mujoco.mjtWarning, f"mjWARN_BAD{x}")) for x in ("QPOS", "QVEL", "QACC")]


def main(arguments=None) -> None:
    options = _options(arguments)
    jaxsim.configure_cpu()
    sources = _sources()
    names = options.models or list(sources)
    compilations = Compilations()
    rows = []
    for name in track(names, "soaking"):
        mj = mujoco.MjModel.from_xml_string(sources[name])
        rows.append({"model": name} | soak(mj, options, compilations, options.steps / len(names)))
    print(common.table(rows))
    total = {key: sum(row[key] for row in rows) for key in ("steps", "diverged", "alone")}
    print(common.table([total]))
    common.write(options, __file__, {"total": total, "rows": rows})


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__ or "", repetitions=1)
    parser.add_argument("--steps", type=float, default=1e8, help="of all models together")
    parser.add_argument("--batch", type=int, default=1024, help="environments")
    parser.add_argument("--models", nargs="+", help="names of some; all bundled and Gymnasium's")
    return parser.parse_args(arguments)


def _sources() -> dict[str, str]:
    """XML of the bundled models, and of those of Gymnasium's tasks, by name."""
    found = {name: bundled_xml(name) for name in bundled_models()}
    package = importlib.util.find_spec("gymnasium")
    folder = pathlib.Path(package.origin).parent / "envs/mujoco/assets"
    names = {f"gymnasium_{path.stem}": path.read_text() for path in sorted(folder.glob("*.xml"))}
    return found | {name: xml for name, xml in names.items() if "<mesh" not in xml}


def soak(mj: mujoco.MjModel, options, compilations: "Compilations", steps: float) -> dict:
    """Simulate one model for so many steps; its row of the table."""
    import jax

    model = jaxsim.load(mj)
    first = jax.vmap(lambda _: jaxsim.make_state(model))(np.arange(options.batch))
    states, rng, count = first, np.random.default_rng(0), Counts()
    calls = max(WARM_UP + 1, round(steps / (options.batch * LENGTH)))
    for call in range(calls):
        if call == WARM_UP:
            started, memory, compiled = time.perf_counter(), _memory(), compilations.count
        ctrls = controls(mj, options.batch, rng)
        after, status = jaxsim.batch_rollout(model, states, ctrls, status=True)
        bad = ~(np.asarray(status.finite) & np.isfinite(after.qpos).all(1))
        count.add(mj, states, ctrls, bad, np.asarray(status.contact_overflow))
        states = jax.tree.map(functools.partial(_chosen, bad), first, after)
    timed = (calls - WARM_UP) * options.batch * LENGTH
    return {
        "steps": calls * options.batch * LENGTH,
        "steps/s": timed / (time.perf_counter() - started),
        "diverged": count.diverged,
        "alone": count.alone,
        "lost contacts": count.lost,
        "memory growth MB": (_memory() - memory) / 1e6,
        "compilations": compilations.count - compiled,
    }


def controls(mj: mujoco.MjModel, batch: int, rng: np.random.Generator) -> np.ndarray:
    """(batch, LENGTH, nu) uniform ones and, in the second half, jumps between the limits."""
    limited = mj.actuator_ctrllimited.astype(bool)
    low, high = np.where(limited[:, None], mj.actuator_ctrlrange, [-1.0, 1.0]).T
    part = rng.uniform(size=(batch, LENGTH, mj.nu))
    jumps = rng.integers(0, 2, size=(batch, -(-LENGTH // HOLD), mj.nu))
    part[batch // 2 :] = np.repeat(jumps, HOLD, axis=1)[batch // 2 :, :LENGTH]
    return (low + (high - low) * part).astype(np.float32)


@dataclasses.dataclass
class Counts:
    """What went wrong so far."""

    diverged: int = 0
    alone: int = 0
    lost: int = 0
    replayed: int = 0

    def add(self, mj: mujoco.MjModel, states, ctrls, bad: np.ndarray, overflow: np.ndarray) -> None:
        """Count a call, of which these lanes went bad; they are tried in MuJoCo C."""
        self.diverged += int(bad.sum())
        self.lost += int((overflow > 0).sum())
        for lane in np.flatnonzero(bad)[: max(0, REPLAYED - self.replayed)]:
            self.replayed += 1
            self.alone += mujoco_goes_on(mj, states, lane, ctrls[lane])


def mujoco_goes_on(mj: mujoco.MjModel, states, lane: int, ctrls: np.ndarray) -> bool:
    """Whether MuJoCo C simulates a lane without a warning."""
    data = mujoco.MjData(mj)
    for name in ("qpos", "qvel", "act", "qacc_warmstart"):
        getattr(data, name)[:] = getattr(states, name)[lane]
    for ctrl in ctrls:
        data.ctrl[:] = ctrl
        mujoco.mj_step(mj, data)
    warned = any(data.warning[k].number for k in WARNINGS)
    return bool(np.isfinite(data.qpos).all() and not warned)


class Compilations:
    """Counts programs that XLA compiles or finds in its cache."""

    def __init__(self):
        import jax

        self.count = 0
        jax.monitoring.register_event_duration_secs_listener(self._heard)

    def _heard(self, event: str, *_, **__) -> None:
        self.count += event.endswith("backend_compile_duration")


def _memory() -> int:
    """Bytes of this process in memory."""
    import psutil

    return psutil.Process().memory_info().rss


def _chosen(lanes: np.ndarray, a, b) -> np.ndarray:
    """`a` in these lanes, `b` in the others."""
    return np.where(lanes.reshape(-1, *[1] * (a.ndim - 1)), a, b)


if __name__ == "__main__":
    main()
