"""Gradients through contact whose answers are known: ours, MuJoCo's differences, MJX's.

Each derivative is the mean over phases, that is, over where within a time step contact begins; with
its standard deviation, and the share of phases with the wrong sign. The truth is that of continuous
motion: with rigid contacts, and with those that were simulated. Where they differ, the difference
is the expected error of springs where rigid contact is meant. The ways are

- program: automatic differentiation of steps with MuJoCo's contact;
- entry times: the same with `Backward(entry_time=True)`;
- hard: automatic differentiation of steps of 20 ms with `contact="hard"`;
- MuJoCo: central differences of rollouts of MuJoCo C;
- MJX: automatic differentiation of its steps in forward mode, where it is installed.
"""

import argparse
import functools
import importlib.util

import common
import gradient_figures
import numpy as np
from gradient_cases import CASES, SCENES, Case, placed

PHASES, LONG, TOLERANCE = 24, 0.02, 1e-10
WAYS = ("program", "entry times", "MuJoCo", "MJX", "hard")


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup(x64=True)
    if "MJX" in options.ways and importlib.util.find_spec("mujoco.mjx") is None:
        print("MJX is not installed: its column is left out")
        options.ways.remove("MJX")
    rows = []
    for case in CASES:
        if not options.cases or case.name in options.cases:
            new = rows_of(case, options.ways, options.phases)
            print(common.table(new, columns(new)), flush=True)
            rows += new
    record = {"phases": options.phases, "rows": rows}
    if options.dry or options.cases:
        common.write(options, __file__, record)
        return
    figures = gradient_figures.measured(RUN)
    record["figures"] = {name: np.asarray(x).tolist() for name, x in figures.items()}
    common.write(options, __file__, record, lambda f: gradient_figures.draw(f, rows, figures))


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=1)
    parser.add_argument("--phases", type=int, default=PHASES, help="starts within two time steps")
    parser.add_argument("--cases", nargs="*", help="names of cases, without figures (default: all)")
    parser.add_argument("--ways", nargs="+", default=list(WAYS), choices=WAYS)
    return parser.parse_args(arguments)


def rows_of(case: Case, ways: list[str], phases: int) -> list[dict]:
    """A row for each derivative and time step of a case, the position itself among them."""
    rows = []
    for dt in case.steps:
        found = {way: _found(case, way, dt, phases) for way in ways if _fits(case, way, dt)}
        for by in case.table:
            row = {"case": case.name, "by": by or "position", "ms": 1e3 * dt}
            row |= _truths(case, by, starts(case, dt, phases))
            for way, values in found.items():
                if by in values:
                    truth = row["truth"] if way == "hard" else row["as simulated"]
                    row |= _summary(way, values[by], truth, spread=bool(by))
            rows.append(row)
    return rows


def _fits(case: Case, way: str, dt: float) -> bool:
    """Whether a way can simulate a case, and is not asked a second time for other steps."""
    return way != "hard" or (case.rigid and dt == case.steps[0])


def starts(case: Case, dt: float, phases: int) -> np.ndarray:
    """Inputs, one of which moves contact through two time steps."""
    name, speed = case.shift
    shifts = (np.arange(phases) + 0.5) / phases * 2 * dt * speed
    return case.vector() + shifts[:, None] * case.direction(name)


def _truths(case: Case, by: str, inputs: np.ndarray) -> dict:
    """Means of the continuous motion over the same starts."""
    soft = np.mean([_truth(case, by, case.solref, x) for x in inputs])
    exact = _truth(case, by, None, case.vector()) if case.rigid else soft
    # Differences of closed forms are known to ten digits.
    exact, soft = (round(float(x), 10) + 0.0 for x in (exact, soft))
    return {"truth": exact, "as simulated": None if by == "e" else soft}


def _found(case: Case, way: str, dt: float, phases: int) -> dict[str, np.ndarray]:
    """Positions and derivatives at each start; less the truth's change from start to start."""
    dt = LONG if way == "hard" else dt
    inputs = starts(case, dt, phases)
    values = {}
    for by in filter(None, case.table):
        if by != "e" or way == "hard":
            values[""], values[by] = RUN[way](case, inputs, case.direction(by), dt)
    if way == "hard":
        for by, found in values.items():
            truth = np.array([_truth(case, by, None, x) for x in inputs])
            values[by] = found - truth + _truth(case, by, None, case.vector())
    return values


def _truth(case: Case, by: str, solref: tuple | None, x: np.ndarray) -> float:
    return case.slope(x, by, solref) if by else case.position(x, solref)


def _summary(way: str, found: np.ndarray, truth: float, spread: bool) -> dict:
    cells = {way: float(found.mean())}
    if spread:
        cells |= {
            f"{way} ±": float(found.std()),
            f"{way} wrong %": float(100 * np.mean(found * truth < 0)),
        }
    return cells


def columns(rows: list[dict]) -> list[str]:
    """Those of the table: numbers of interest only."""
    every = dict.fromkeys(key for row in rows for key in row)
    return [c for c in every if not c.startswith("hard ")]


@functools.cache
def _ours(scene: str, contact: str, entry_time: bool):
    """A compiled function of (inputs, direction, solref, dt, steps): position and slope."""
    import jax

    import jaxsim

    backward = jaxsim.gradients.Backward(entry_time=entry_time)
    model = jaxsim.load(SCENES[scene].xml, contact=contact, backward=backward)

    def end(inputs, solref, dt, steps):
        changed, state = _begun(model, jaxsim.make_state(model), inputs, solref, dt)
        step = lambda _, s: jaxsim.step(changed, s)  # noqa: E731
        return jax.lax.fori_loop(0, steps, step, state).qpos

    return _along(end, jaxsim.vmap)


@functools.cache
def _mjx(scene: str, friction: bool):
    """The same by MJX; without friction, contacts have one dimension: at rest others are NaN."""
    import jax
    import mujoco
    from mujoco import mjx

    xml = SCENES[scene].xml
    if not friction:
        xml = xml.replace("<geom solimp", '<geom condim="1" solimp').replace('cone="elliptic" ', "")
    mj = mujoco.MjModel.from_xml_string(xml)
    model, data = mjx.put_model(mj), mjx.make_data(mj)

    def end(inputs, solref, dt, steps):
        changed, start = _begun(model, data, inputs, solref, dt)
        # With a tolerance of zero all iterations are made, which costs minutes.
        changed = changed.replace(opt=changed.opt.replace(tolerance=TOLERANCE))
        step = lambda _, d: mjx.step(changed, d)  # noqa: E731
        return jax.lax.fori_loop(0, steps, step, start).qpos

    return _along(end, jax.vmap)


def _begun(model, data, inputs, solref, dt):
    """A model and a state with some inputs; those of jaxsim and MJX have the same names."""
    import jax.numpy as jnp

    values = placed(inputs, jnp)
    motion = {name: values.pop(name) for name in ("qpos", "qvel")}
    opt = model.opt.replace(timestep=dt, gravity=values.pop("gravity"))
    values["geom_solref"] = jnp.tile(solref, (2, 1))
    there = {name: value for name, value in values.items() if hasattr(model, name)}
    return model.replace(opt=opt, **there), data.replace(**motion)


def _along(end, vmap):
    """Positions and their derivatives along a direction, for a batch of inputs."""
    import jax

    def both(inputs, direction, *rest):
        return jax.jvp(lambda x: end(x, *rest), (inputs,), (direction,))

    # Each program runs a few times: less time to compile is worth more than speed.
    quick = None
    batch = lambda x, *rest: vmap(lambda x: both(x, *rest))(x)  # noqa: E731
    return jax.jit(batch, compiler_options=quick)


def _automatic(program):
    """Positions and slopes of a case by a compiled program, which is shared by cases."""

    def run(case: Case, inputs, direction, dt):
        steps = round(case.duration / dt)
        found = program(case)(inputs, direction, np.array(case.solref), dt, steps)
        return (np.asarray(x)[:, case.end] for x in found)

    return run


def _mujoco(case: Case, inputs, direction, dt, h=1e-7):
    """Central differences of MuJoCo C."""
    import mujoco

    mj = mujoco.MjModel.from_xml_string(SCENES[case.scene].xml)
    mj.opt.timestep, mj.geom_solref[:] = dt, case.solref
    data = mujoco.MjData(mj)

    def end(x):
        values = placed(x, np)
        mj.opt.gravity[:] = values.pop("gravity")
        del values["geom_restitution"]
        mj.body_mass[:] = values["body_mass"]
        mujoco.mj_setConst(mj, data)
        mujoco.mj_resetData(mj, data)
        for name, value in values.items():
            getattr(data if name in ("qpos", "qvel") else mj, name)[:] = value
        for _ in range(round(case.duration / dt)):
            mujoco.mj_step(mj, data)
        return data.qpos[case.end]

    ends = np.array([[end(x + h * direction), end(x - h * direction)] for x in inputs])
    return ends.mean(axis=1), (ends[:, 0] - ends[:, 1]) / (2 * h)


RUN = {
    "program": _automatic(lambda case: _ours(case.scene, "mujoco", entry_time=False)),
    "entry times": _automatic(lambda case: _ours(case.scene, "mujoco", entry_time=True)),
    "hard": _automatic(lambda case: _ours(case.scene, "hard", entry_time=False)),
    "MuJoCo": _mujoco,
    "MJX": _automatic(lambda case: _mjx(case.scene, "mu" in case.start)),
}

if __name__ == "__main__":
    main()
