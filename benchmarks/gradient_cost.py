"""Reverse mode through many steps: its cost in forward passes, its memory, its accuracy.

The gradient of a function of the last state with respect to constant controls, for a batch on one
thread, with `jaxsim.checkpoint` around the step as `jaxsim.rollout` has it. Both passes go through
the batch in chunks of "lanes" environments, as training does. "forwards" is the time of the
gradient, its own forward pass included, in passes without a gradient. Memory is what the compiled
gradient needs beside its arguments, for each environment of a chunk and step. The error is relative
to the same gradient in float64, over the batch: median, and share of environments below 1 per
cent; contact makes long rollouts sensitive, and the rest are those where rounding decides a
touchdown. Central differences in float64 along a random direction check a gradient whose solver
runs to the end: gradients are those of the exact minimum, also where the model's settings stop the
solver before it is reached.
"""

import argparse
import copy
import functools

import common
import models
import numpy as np


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup()
    rows = []
    for name in options.models:
        rows.append(_row(name, options))
        print(common.table(rows[-1:]), flush=True)
    common.write(options, __file__, {"rows": rows}, lambda figure: _draw(figure, rows))


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=7)
    models.add_options(parser)
    parser.add_argument("--steps", type=int, default=32, help="steps of the rollout")
    return parser.parse_args(arguments)


def _row(name: str, options) -> dict:
    """Times, memory and errors of one model."""
    import jaxsim
    from jaxsim.parallel.chunks import even_lanes

    mj = models.load(name, options.menagerie)
    states = models.visited(mj, options.states)
    model = jaxsim.load(mj)
    batch = states.batch(model, options.batch)
    lanes = even_lanes(model, options.batch)
    loss, gradient = (common.in_chunks(f, lanes) for f in _programs(model, options.steps))
    forward, _, forward_compile = common.compile_for(loss, *batch)
    reverse, program, reverse_compile = common.compile_for(gradient, *batch)
    candidates = {"forward": forward, "reverse": reverse}
    times = common.interleave(candidates, options.repetitions, clock=options.clock)
    per_step = options.batch * options.steps
    return {
        "model": name,
        "lanes": lanes,
        "forward us": 1e6 * times["forward"].per(per_step).median,
        "gradient us": 1e6 * times["reverse"].per(per_step).median,
        "forwards": times["reverse"].median / times["forward"].median,
        "bytes": program.memory_analysis().temp_size_in_bytes / (lanes * options.steps),
        "compile s": reverse_compile,
        "forward compile s": forward_compile,
    } | _accuracy(mj, states, options, np.asarray(reverse()))


def _programs(model, steps: int):
    """A function of (state, ctrl) and its gradient with respect to ctrl."""
    import jax

    import jaxsim

    step = jaxsim.checkpoint(functools.partial(jaxsim.step, model))

    def loss(ctrl, state):
        state, _ = jax.lax.scan(lambda s, _: (step(s, ctrl), None), state, None, length=steps)
        return (state.qpos**2).sum() + (state.qvel**2).sum()

    return lambda s, u: loss(u, s), lambda s, u: jax.grad(loss)(u, s)


def _accuracy(mj, states, options, found: np.ndarray) -> dict:
    """Errors to float64, and of float64 to differences."""
    import jax

    import jaxsim

    with jax.enable_x64(True):
        model = jaxsim.load(mj)
        state, ctrl = states.batch(model, options.states)
        exact = np.asarray(jax.jit(jaxsim.vmap(_programs(model, options.steps)[1]))(state, ctrl))
        off = _off(_to_the_end(mj), states, options)
    size = np.abs(exact).max(axis=1) + 1e-12
    error = np.abs(found[: options.states] - exact).max(axis=1) / size
    return {
        "error": float(np.median(error)),
        "below 1 %": float(100 * np.mean(error < 1e-2)),
        "float64 to differences": float(np.median(off)),
    }


def _to_the_end(mj):
    """The model with a solver that stops at its minimum only."""
    mj = copy.copy(mj)
    mj.opt.iterations, mj.opt.ls_iterations, mj.opt.tolerance = 100, 50, 1e-12
    return mj


def _off(mj, states, options) -> np.ndarray:
    """Relative error of slopes along a random direction, for each state."""
    import jax

    import jaxsim

    model = jaxsim.load(mj)
    state, ctrl = states.batch(model, options.states)
    loss, gradient = (jax.jit(jaxsim.vmap(f)) for f in _programs(model, options.steps))
    exact = np.asarray(gradient(state, ctrl))
    way = np.random.default_rng(0).standard_normal(ctrl.shape)
    ends = [np.asarray(loss(state, ctrl + h * way)) for h in (1e-7, -1e-7)]
    slope, size = (exact * way).sum(axis=1), np.abs(exact).max(axis=1) + 1e-12
    return np.abs((ends[0] - ends[1]) / 2e-7 - slope) / (np.abs(slope) + 1e-3 * size)


def _draw(figure, rows) -> None:
    """Bars of the cost in forward passes."""
    axes = figure.subplots()
    axes.bar([r["model"] for r in rows], [r["forwards"] for r in rows])
    axes.axhline(4, color="gray", linestyle=":")
    axes.set(ylabel="cost of a gradient in forward passes")


if __name__ == "__main__":
    main()
