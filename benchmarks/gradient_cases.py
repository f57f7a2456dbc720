"""Gradients through contact whose answers are known: the program's, with entry times, MuJoCo's.

A bouncing ball, and two balls that meet. Each gradient is the mean over phases, that is, over
where within a time step the contact begins: its mean, its standard deviation, and the share of
phases with the wrong sign. MuJoCo's are central differences of its own steps. The truth is that of
rigid impacts, for which springs are stiff here, or of the continuous motion with soft contact.
"""

import argparse
from typing import NamedTuple

import common
import numpy as np

PHASES = 64
CONTACT = '<default><geom condim="1" solimp=".95 .95 .001" solref="{ref}"/></default>'
BALL = f"""
<mujoco><option timestep="{{dt}}" gravity="0 0 -{{g}}" tolerance="0"/>{CONTACT}
<worldbody><geom type="plane" size="0 0 1"/>
<body><joint type="slide" axis="0 0 1"/><geom size=".1" contype="0"/></body></worldbody></mujoco>
"""
SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
BALLS = f"""
<mujoco><option timestep="{{dt}}" gravity="0 0 0" tolerance="0"/>{CONTACT}
<worldbody><body>{SLIDES}<geom size="{{size}}" mass="1"/></body>
<body>{SLIDES}<geom size="{{size}}" mass="1"/></body></worldbody></mujoco>
"""


class Case(NamedTuple):
    """A motion, one derivative of its end, and their truth.

    Attributes:
      name: of the case, and what the derivative is with respect to.
      dt: time step (s).
      ref: `solref` of the contact.
      start: positions, then velocities.
      end: index of the final position.
      by: index of the start.
      value: truth of the final position.
      truth: truth of the derivative, over the heights of two time steps.
      speed: at which the surfaces meet.
      duration: of the motion (s).
      size: radius of two balls; None for one.
      g: gravity.
    """

    name: str
    dt: float
    ref: str
    start: tuple
    end: int
    by: int
    value: float
    truth: float
    speed: float = 4.2021
    duration: float = 0.8
    size: float | None = None
    g: float = 9.81

    @property
    def xml(self) -> str:
        return (BALLS if self.size else BALL).format(**self._asdict())


DRAWN = "G3b by z", 1e-3
STIFF = "-1e6 0"
LOSSY = "-1e6 -147.4"  # of restitution 0.8: the damping ratio is 0.0737
FREE = {"speed": 2.0, "duration": 1.0, "g": 0}
TOSS, MEET, ASIDE = (1, -2), (0, 0, 0.52, 0, 1, 0, 0, 0), (0, 0, 1, 0.15, 2, 0, 0, 0)
CASES = [
    Case("G1 by z", 1e-4, STIFF, TOSS, 0, 0, 1.2, -1, **FREE),
    Case("G2 by z", 1e-4, LOSSY, (1, 0), 0, 0, 0.671885, 0.761714),
    Case("G3 by z", 1e-3, ".02 .1", (1, 0), 0, 0, 0.586167, 0.737),
    Case("G3 by z", 5e-4, ".02 .1", (1, 0), 0, 0, 0.586167, 0.741),
    Case("G3b by z", 4e-3, ".1 .1", (1, 0), 0, 0, 0.589593, 0.616),
    Case("G3b by z", 2e-3, ".1 .1", (1, 0), 0, 0, 0.589593, 0.630),
    Case("G3b by z", 1e-3, ".1 .1", (1, 0), 0, 0, 0.589593, 0.637),
    Case("G10 by x", 1e-4, STIFF, MEET, 2, 0, 1.2, 1, **(FREE | {"speed": 1.0}), size=0.1),
    Case("G11 by y", 5e-5, "-1e7 0", ASIDE, 2, 3, 2.17803977874, -2.91790291225, **FREE, size=0.2),
]


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup(x64=True)
    rows = []
    for case in CASES:
        if options.cases and case.name.split()[0] not in options.cases:
            continue
        rows += [_row(case, method, options.phases) for method in METHODS]
        print(common.table(rows[-len(METHODS) :], COLUMNS), flush=True)
    record = {"phases": options.phases, "rows": rows}
    common.write(options, __file__, record, lambda figure: _draw(figure, rows))


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=1)
    parser.add_argument("--phases", type=int, default=PHASES, help="starts within two time steps")
    parser.add_argument("--cases", nargs="*", help="names of cases (default: all)")
    return parser.parse_args(arguments)


def _row(case: Case, method: str, phases: int) -> dict:
    """Mean and spread of one derivative over phases."""
    shift = (np.arange(phases) + 0.5) / phases * 2 * case.dt * case.speed
    start = np.tile(np.array(case.start, float), (phases, 1))
    # Two balls come nearer to each other if the first one moves forwards.
    start[:, 0] += shift if case.size is None else -shift
    found, slopes = METHODS[method](case, start)
    drawn = {"starts": start[:, 0].tolist(), "slopes": slopes.tolist()}
    return (drawn if (case.name, case.dt) == DRAWN else {}) | {
        "case": case.name,
        "dt": case.dt,
        "method": method,
        "value": float(found.mean()),
        "its truth": case.value,
        "derivative": float(slopes.mean()),
        "truth": case.truth,
        "spread": float(slopes.std()),
        "wrong sign %": float(100 * np.mean(slopes * case.truth < 0)),
    }


COLUMNS = "case,dt,method,value,its truth,derivative,truth,spread,wrong sign %".split(",")


def _ours(entry_time: bool):
    def run(case: Case, start):
        import jax
        import jax.numpy as jnp

        import jaxsim

        model = jaxsim.load(case.xml, backward=jaxsim.gradients.Backward(entry_time=entry_time))

        def end(x):
            state = jaxsim.make_state(model).replace(qpos=x[: model.nv], qvel=x[model.nv :])
            after = jax.lax.fori_loop(
                0, round(case.duration / case.dt), lambda _, s: jaxsim.step(model, s), state
            )
            return after.qpos[case.end]

        along = np.eye(start.shape[1])[case.by]
        both = jaxsim.vmap(lambda x: jax.jvp(end, (x,), (jnp.asarray(along),)))
        # Each program runs once: less time to compile is worth more than speed.
        both = jax.jit(both, compiler_options={"xla_backend_optimization_level": 0})
        return tuple(np.asarray(a) for a in both(start))

    return run


def _mujoco(case: Case, start):
    """Central differences of MuJoCo C, and the values between."""
    import mujoco

    mj = mujoco.MjModel.from_xml_string(case.xml)
    data = mujoco.MjData(mj)

    def end(x):
        mujoco.mj_resetData(mj, data)
        data.qpos[:], data.qvel[:] = x[: mj.nq], x[mj.nq :]
        for _ in range(round(case.duration / case.dt)):
            mujoco.mj_step(mj, data)
        return data.qpos[case.end]

    h = 1e-7 * np.eye(start.shape[1])[case.by]
    ends = np.array([[end(x + h), end(x - h)] for x in start])
    return ends.mean(axis=1), (ends[:, 0] - ends[:, 1]) / 2e-7


METHODS = {
    "program": _ours(False),
    "entry times": _ours(True),
    "MuJoCo's differences": _mujoco,
}


def _draw(figure, rows) -> None:
    """Gradient against phase, and error against the time step, for the soft bounce."""
    left, right = figure.subplots(1, 2)
    colours = {"program": "C1", "entry times": "C0"}
    for row in rows:
        if "slopes" in row and row["method"] in colours:
            heights = 1e3 * (np.array(row["starts"]) - 1)
            left.plot(
                heights, row["slopes"], ".", color=colours[row["method"]], label=row["method"]
            )
    left.axhline(0.637, color="gray", linestyle=":", label="continuous motion")
    left.set(xlabel="height above 1 m (mm)", ylabel="dz / dz0", title="soft bounce, 1 ms")
    left.legend()
    for method, colour in colours.items():
        some = [r for r in rows if r["case"].startswith("G3b") and r["method"] == method]
        dts = [1e3 * r["dt"] for r in some]
        errors = [abs(r["derivative"] - r["truth"]) for r in some]
        spreads = [r["spread"] for r in some]
        right.loglog(dts, errors, "o-", color=colour, label=f"{method}: error of the mean")
        right.loglog(dts, spreads, "s:", color=colour, label=f"{method}: spread")
    right.set(xlabel="time step (ms)", ylabel="error", title="over phases")
    right.legend(fontsize=7)


if __name__ == "__main__":
    main()
