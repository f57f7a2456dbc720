"""Plots of trajectories: quantities, energy, contact forces, gradients."""

from collections.abc import Mapping, Sequence

import jax
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.engine import forward
from jaxsim.model import Model, State
from jaxsim.viz.batch import batched
from jaxsim.viz.models import looks_of, physics_of
from jaxsim.viz.picture import Picture, draw_lines
from jaxsim.viz.touch import touches

_LABELS = {"qpos": "position", "qvel": "velocity", "act": "activation"}


def plot_trajectory(
    trajectory: State,
    quantities: Mapping[str, Array] | Sequence[str] = ("qpos", "qvel"),
    title: str = "",
) -> Picture:
    """Draw quantities of a trajectory against time, one panel for each.

    Args:
      trajectory: states of one environment, (T, ...).
      quantities: names of fields of the state; or arrays (T,) or (T, k) by name.
      title: above the picture.

    Returns:
      The picture; of a quantity with many components the first twelve.

    Raises:
      ValueError: an array has another length than the trajectory.
    """
    time = np.asarray(trajectory.time)
    if not isinstance(quantities, Mapping):
        quantities = {_LABELS.get(n, n): getattr(trajectory, n) for n in quantities}
    picture = Picture(rows=len(quantities), title=title, sharex=True)
    for axes, (name, values) in zip(picture.axes, quantities.items(), strict=True):
        values = np.asarray(values)
        if values.ndim not in (1, 2) or len(values) != time.size:
            raise ValueError(
                f"quantities[{name!r}] must have shape ({time.size},) or ({time.size}, k), "
                f"got {values.shape}"
            )
        draw_lines(axes, time, values)
        axes.set_ylabel(name)
    picture.axes[-1].set_xlabel("time (s)")
    return picture


def plot_energy(model: Model | mujoco.MjModel, trajectory: State, title: str = "") -> Picture:
    """Draw potential, kinetic and total energy of a trajectory (J) against time.

    Args:
      model: what was simulated.
      trajectory: states of one environment, (T, ...).
      title: above the picture.
    """
    model = physics_of(model)
    energy = jax.jit(lambda states: jax.lax.map(lambda s: forward(model, s).energy, states))
    potential, kinetic = np.asarray(energy(trajectory)).T
    picture, time = Picture(title=title), np.asarray(trajectory.time)
    axes = picture.axes[0]
    for name, values in (
        ("potential", potential - potential[0]),
        ("kinetic", kinetic),
        ("total", potential - potential[0] + kinetic),
    ):
        axes.plot(time, values, label=name)
    axes.set(xlabel="time (s)", ylabel="energy (J), from the first state")
    axes.legend()
    return picture


def plot_contact_forces(
    model: Model | mujoco.MjModel,
    trajectory: State,
    ctrls: Float[Array, "T nu"] | None = None,
    title: str = "",
) -> Picture:
    """Draw the sum of the sizes of all contact forces (N), and the number of contacts.

    Args:
      model: what was simulated.
      trajectory: states of one environment, (T, ...).
      ctrls: controls that go with the states; zeros if None.
      title: above the picture.

    Returns:
      Two panels, against time.

    Raises:
      ValueError: shapes do not fit together.
    """
    source = looks_of(model)
    batch = batched(source, trajectory, "trajectory")
    (found,) = touches(model, batch, ctrls, np.arange(batch.qpos.shape[1]))
    picture = Picture(rows=2, title=title, sharex=True)
    time = np.asarray(batch.time[0])
    picture.axes[0].plot(time, found.totals())
    picture.axes[0].set_ylabel("contact forces (N)")
    picture.axes[1].step(time, np.diff(found.first), where="post")
    picture.axes[1].set(xlabel="time (s)", ylabel="contacts")
    return picture


def plot_gradient(
    parameter: Float[Array, "n"],
    value: Float[Array, "n"],
    slopes: Mapping[str, Float[Array, "n"]],
    name: str = "parameter",
    title: str = "",
) -> Picture:
    """Draw a function of one parameter, and its slope by several ways beside differences.

    Args:
      parameter: where the function was taken.
      value: of the function.
      slopes: derivatives by name, for instance `{"jax.grad": ...}`.
      name: of the parameter.
      title: above the picture.

    Returns:
      Two panels: the function; its slopes, with the differences of the drawn values in grey.
    """
    at, picture = np.asarray(parameter), Picture(columns=2, title=title)
    left, right = picture.axes
    left.plot(at, value)
    left.set(xlabel=name, ylabel="value")
    differences = np.gradient(np.asarray(value), at)
    right.plot(at, differences, color="0.7", lw=4, label="differences")
    for label, slope in slopes.items():
        right.plot(at, slope, label=label)
    right.set(xlabel=name, ylabel="slope")
    right.legend()
    return picture
