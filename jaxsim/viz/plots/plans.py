"""What an optimiser planned, as plots and as a film."""

import pathlib
from typing import Any

import jax
import numpy as np
from jax.flatten_util import ravel_pytree

from jaxsim.model import Model, State
from jaxsim.viz.batch import batched
from jaxsim.viz.filming import film
from jaxsim.viz.models import looks_of
from jaxsim.viz.picture import Picture, draw_lines
from jaxsim.viz.touch import touches


def plot_plan(problem: Any, plan: Any, title: str = "") -> Picture:
    """Draw a plan against time: states, controls, and what contacts do.

    Args:
      problem: what was planned for, a `jaxsim.trajopt.Problem`.
      plan: what `jaxsim.trajopt.solve` returned.
      title: above the picture.

    Returns:
      Panels, those that apply: positions and velocities, or states; controls; the size of all
      contact forces together (N); the largest product of a pair that is to be complementary.

    Raises:
      ValueError: the plan is for another problem.
    """
    panels, unit = _panels(problem, plan)
    picture = Picture(rows=len(panels), title=title, sharex=True)
    for axes, (name, (time, values)) in zip(picture.axes, panels.items(), strict=True):
        draw_lines(axes, time, values)
        axes.set_ylabel(name)
        if name == _PRODUCTS:
            axes.set_yscale("log")
    picture.axes[-1].set_xlabel(unit)
    return picture


def film_plan(
    problem: Any, plan: Any, path: str | pathlib.Path, *, contacts: bool = True, **options: Any
) -> pathlib.Path:
    """Draw the motion that the controls of a plan lead to, and write it as MP4 or GIF.

    Args:
      problem: what was planned for; its dynamics are a model.
      plan: what `jaxsim.trajopt.solve` returned.
      path: file to write.
      contacts: mark contact points, and forces as the model's own law has them.
      **options: of `film`.

    Returns:
      The file written.

    Raises:
      ValueError: the dynamics are no model, or the plan is for another problem.
      RuntimeError: as `film`.
    """
    model = _model_of(problem)
    if model is None:
        raise ValueError("film_plan needs a problem whose dynamics are a jaxsim.Model")
    _check(problem, plan)
    states = jax.jit(problem.rollout)(plan.ctrls)[0]
    given = _with_last(plan.ctrls[:, : model.nu]) if contacts else None
    return film(model, states, path, contacts=contacts, ctrls=given, **options)


_PRODUCTS = "products of pairs"


def _panels(problem: Any, plan: Any) -> tuple[dict[str, tuple[Any, Any]], str]:
    """Times and numbers of each panel by name, and what time is counted in."""
    _check(problem, plan)
    model, steps = _model_of(problem), np.arange(problem.horizon + 1)
    ctrls = np.asarray(plan.ctrls)
    panels: dict[str, tuple[Any, Any]]
    if model is None:
        time, unit = steps, "step"
        panels = {"state": (time, np.asarray(jax.vmap(lambda x: ravel_pytree(x)[0])(plan.states)))}
    else:
        states, ctrls = plan.states, ctrls[:, : model.nu]
        time, unit = np.asarray(states.time), "time (s)"
        panels = {"position": (time, states.qpos), "velocity": (time, states.qvel)}
    panels["control"] = time[:-1], ctrls
    if problem.normal_forces is not None:
        forces = jax.vmap(problem.normal_forces)(_before(plan), plan.ctrls)
        panels["normal forces (N)"] = time[:-1], forces
    elif model is not None and (found := _contact_forces(model, plan.states, ctrls)).any():
        panels["contact forces (N)"] = time, found
    if problem.complementarity is not None:
        after = jax.tree.map(lambda x: x[1:], plan.states)
        a, b = jax.vmap(problem.complementarity)(_before(plan), plan.ctrls, after)
        panels[_PRODUCTS] = time[1:], np.abs(a * b).max(axis=1)
    return panels, unit


def _contact_forces(model: Model, states: State, ctrls: np.ndarray) -> np.ndarray:
    """The sizes of all contact forces together, at each time."""
    batch = batched(looks_of(model), states, "plan.states")
    (found,) = touches(model, batch, _with_last(ctrls), np.arange(len(ctrls) + 1))
    return found.totals()


def _before(plan: Any) -> Any:
    """The states in which controls are applied."""
    return jax.tree.map(lambda x: x[:-1], plan.states)


def _with_last(ctrls: Any) -> Any:
    """Controls for every state: the last one twice."""
    return np.concatenate([ctrls, ctrls[-1:]])


def _model_of(problem: Any) -> Model | None:
    return getattr(problem.space, "model", None)


def _check(problem: Any, plan: Any) -> None:
    shape = (problem.horizon, *problem.low.shape)
    if np.shape(plan.ctrls) != shape:
        raise ValueError(
            f"a plan for this problem has ctrls of shape {shape}, got {np.shape(plan.ctrls)}; "
            "of a batch, draw one plan at a time"
        )
