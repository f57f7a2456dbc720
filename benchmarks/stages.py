"""Where the time of a step goes: kinematics, smooth dynamics, collision, rows, solver, integration.

Programs of growing length are compiled for one batch, as kernels where steps are, each giving out
the sum of all that the next stage needs, and timed in turn on one thread, which goes through the
batch in chunks, as rollouts do; a stage costs the difference between two of them. The compiler
fuses across stages, so that small differences are noise, and the sums cost time, too: as the whole
step does without them, the last stage may come out below zero. A primer on simulation puts
collision at 30-50, the solver at 20-40 and dynamics at 10-20 per cent, without a source.
"""

import argparse

import common
import models

STAGES = (
    "kinematics",
    "smooth dynamics",
    "collision",
    "constraint rows",
    "solver",
    "integration",
)


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup()
    rows = []
    for name in options.models:
        rows.append(_shares(name, options))
        print(common.table(rows[-1:]), flush=True)
    common.write(options, __file__, {"rows": rows}, lambda figure: _draw(figure, rows))


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=9)
    models.add_options(parser)
    return parser.parse_args(arguments)


def _shares(name: str, options) -> dict:
    """Microseconds of the whole step for one environment, and the share of each stage."""
    import jaxsim
    from jaxsim.parallel.chunks import even_lanes

    mj = models.load(name, options.menagerie)
    model, states = jaxsim.load(mj), models.visited(mj, options.states)
    batch = states.batch(model, options.batch)
    lanes, programs = even_lanes(model, options.batch), {}
    for stage, f in zip(STAGES, _programs(model), strict=True):
        programs[stage] = common.compile_for(common.in_chunks(f, lanes), *batch)[0]
    times = common.interleave(programs, options.repetitions, clock=options.clock)
    until = [times[stage].median for stage in STAGES]
    alone = [b - a for a, b in zip([0.0, *until], until, strict=False)]
    row = {"model": name, "us": 1e6 * until[-1] / options.batch}
    return row | {f"{s} %": 100 * t / until[-1] for s, t in zip(STAGES, alone, strict=True)}


def _programs(model):
    """Functions of (state, ctrl) that end after each stage."""
    import jax
    import jax.numpy as jnp

    import jaxsim
    from jaxsim.dynamics.kinematics import kinematics
    from jaxsim.engine.stepping import evaluate, steps_are_kernels
    from jaxsim.lanes import as_kernel

    def positions(state, ctrl):
        return _total(kinematics(model, state.qpos, state.mocap_pos, state.mocap_quat))

    # What of an instant does not enter the total is not computed.
    def smooth(state, ctrl):
        now = evaluate(model, state, ctrl)
        return _total(_smooth(now))

    def contacts(state, ctrl):
        now = evaluate(model, state, ctrl)
        return _total((_smooth(now), now.constrained.contact))

    def rows(state, ctrl):
        now = evaluate(model, state, ctrl)
        blocks = [(b.kind, b.jacobian) for b in now.constrained.blocks]
        return _total((_smooth(now), now.constrained.contact, blocks))

    def solved(state, ctrl):
        now = evaluate(model, state, ctrl)
        return _total((_smooth(now), now.qacc, now.constrained.qfrc_constraint))

    def _smooth(now):
        motion = now.motion.replace(model=None)
        return motion, now.passive, now.actuation, now.qfrc_smooth

    def _total(tree):
        arrays = [x for x in jax.tree.leaves(tree) if isinstance(x, jax.Array)]
        return sum(jnp.sum(x.astype(float)) for x in arrays)

    parts = [positions, smooth, contacts, rows, solved]
    if steps_are_kernels(model):
        parts = [as_kernel(f, finite_math=True) for f in parts]
    return *parts, lambda s, u: jaxsim.step(model, s, u)


def _draw(figure, rows) -> None:
    """One bar for each model, stages on top of each other."""
    axes = figure.subplots()
    names, bottom = [row["model"] for row in rows], [0.0] * len(rows)
    for stage in STAGES:
        shares = [max(row[f"{stage} %"], 0) for row in rows]
        axes.bar(names, shares, bottom=bottom, label=stage)
        bottom = [a + b for a, b in zip(bottom, shares, strict=True)]
    axes.set(ylabel="per cent of a step")
    axes.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1, 1))


if __name__ == "__main__":
    main()
