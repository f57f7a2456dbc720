"""Figures of `gradients.py`: phases, time steps, a landscape and horizons."""

import functools

import numpy as np
from gradient_cases import CASES

MODEL, HORIZON, HELD = "half_cheetah", 300, 20
COLOURS = {"program": "C1", "entry times": "C0"}
LANDSCAPE_STEP = 4e-3


def measured(run: dict) -> dict[str, np.ndarray]:
    """What is drawn but is in no table.

    Args:
      run: by way, a function of (case, inputs, direction, dt) to positions and slopes.
    """
    case = next(case for case in CASES if case.name == "G3b")
    found = {}
    for name, dt, travel in (("phase", 1e-3, 2), ("landscape", LANDSCAPE_STEP, 6)):
        heights = np.linspace(0, travel * dt * case.shift[1], 192)
        inputs = case.vector() + heights[:, None] * case.direction("z")
        found[f"{name}: start"] = inputs[:, 1]
        found[f"{name}: truth"] = np.array([case.position(x, case.solref) for x in inputs])
        for way in COLOURS:
            position, slope = run[way](case, inputs, case.direction("z"), dt)
            found[f"{name}: {way}"], found[f"{name}: end"] = slope, position
    for name, softening in (("program", 1.0), ("softening 3", 3.0)):
        found[f"horizon: {name}"] = _norms(softening)
    return found


def _norms(softening: float) -> np.ndarray:
    """Norm of the gradient against the horizon, from the end backwards."""
    import jax
    import jax.numpy as jnp

    import jaxsim

    model = jaxsim.load(MODEL, backward=jaxsim.gradients.Backward(softening=softening))
    ctrl = np.random.default_rng(0).uniform(-1, 1, (HORIZON // HELD, model.nu)).repeat(HELD, 0)
    loss = lambda state: jnp.sum(state.qpos**2)  # noqa: E731
    run = functools.partial(jaxsim.gradients.gradient_norms, functools.partial(jaxsim.step, model))
    return np.asarray(jax.jit(functools.partial(run, loss))(jaxsim.make_state(model), ctrl))[::-1]


def draw(figure, rows: list[dict], found: dict[str, np.ndarray]) -> None:
    """Four panels."""
    figure.set_size_inches(10, 8)
    phase, steps, landscape, horizon = figure.subplots(2, 2).ravel()
    _draw_phase(phase, found)
    _draw_steps(steps, [row for row in rows if row["case"] == "G3b" and row["by"] == "z"])
    _draw_landscape(landscape, found)
    for name, style in (("program", "C1-"), ("softening 3", "C2-")):
        horizon.semilogy(found[f"horizon: {name}"], style, label=name)
    horizon.set(xlabel="horizon (steps)", ylabel="norm of the gradient", title=MODEL)
    horizon.legend()


def _draw_phase(axes, found) -> None:
    for way, colour in COLOURS.items():
        height = 1e3 * (found["phase: start"] - 1)
        axes.plot(height, found[f"phase: {way}"], ".", color=colour, label=way)
    slope = np.gradient(found["phase: truth"], found["phase: start"])
    axes.plot(height, slope, color="gray", label="continuous motion")
    axes.set(xlabel="height above 1 m (mm)", ylabel="dz / dz0", title="soft bounce, 1 ms")
    axes.legend()


def _draw_steps(axes, rows) -> None:
    dts = [row["ms"] for row in rows]
    for way, colour in COLOURS.items():
        errors = [abs(row[way] - row["as simulated"]) for row in rows]
        axes.loglog(dts, errors, "o-", color=colour, label=f"{way}: error of the mean")
        spreads = [row[f"{way} ±"] for row in rows]
        axes.loglog(dts, spreads, "s:", color=colour, label=f"{way}: spread")
    axes.set(xlabel="time step (ms)", ylabel="error of dz / dz0", title="soft bounce, phases")
    axes.legend(fontsize=8)


def _draw_landscape(axes, found) -> None:
    """A saw, its tangents, and the motion that it stands for."""
    start, end = found["landscape: start"], found["landscape: end"]
    height = 1e3 * (start - 1)
    axes.plot(height, found["landscape: truth"], color="gray", label="continuous motion")
    axes.plot(height, end, ".", color="C1", markersize=3, label="program")
    reach = np.array([-1, 1]) * 4e-3
    for way, colour in COLOURS.items():
        for i in range(16, len(start), 40):
            line = end[i] + found[f"landscape: {way}"][i] * reach
            axes.plot(height[i] + 1e3 * reach, line, color=colour if way != "program" else "C3",
                      label=f"slope: {way}" if i == 16 else None)  # fmt: skip
    title = f"soft bounce, {1e3 * LANDSCAPE_STEP:.0f} ms"
    axes.set(xlabel="height above 1 m (mm)", ylabel="height after 0.8 s (m)", title=title)
    axes.legend(fontsize=8)
