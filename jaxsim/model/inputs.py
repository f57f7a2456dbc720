"""Validation of arguments at the public functions.

Shapes and types are known while a function is traced. A mistake raises an error then, and the
compiled program checks nothing.
"""

import dataclasses
import functools
import math
import typing
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from jaxsim.model.errors import expect
from jaxsim.model.facts import fact
from jaxsim.model.model import DELAYS, Model, Option, Statistic
from jaxsim.model.state import State

Shape = tuple[int | None, ...]
Record = TypeVar("Record")


def admit(
    model: Model, state: State, ctrl: Any = None, batch: Shape = ()
) -> tuple[Model, State, jax.Array | None]:
    """Validate a model, a state and controls, and convert them to the model's number type.

    Python numbers and NumPy arrays become JAX arrays of that type, and so do controls of another
    precision.

    Args:
      model: the model.
      state: the state.
      ctrl: (*batch, nu) controls, or None.
      batch: leading axes of the state's arrays and of the controls.

    Returns:
      All three; the same objects where there is nothing to convert.

    Raises:
      TypeError: an argument is of the wrong class, or its numbers are of the wrong type.
      ValueError: an array has the wrong shape, or the timestep is not positive.
    """
    if isinstance(model, State) and isinstance(state, Model):
        raise TypeError("the model comes first, then the state; got them the other way round")
    model = admit_model(model)
    expect(state, State, "jaxsim.make_state")
    shapes = {name: batch + shape for name, shape in _shapes(model)["state"].items()}
    if state.history is not None and not model.nhistory:
        raise ValueError("state.history must be None: the model has no delays")
    state = _admitted(state, shapes, _number_type(model), "states" if batch else "state")
    if ctrl is not None:
        ctrl = admit_array(model, ctrl, (*batch, model.nu), "ctrl")
    return model, state, ctrl


def admit_model(model: Model) -> Model:
    """Validate a model; as `admit`, for the model alone."""
    expect(model, Model, "jaxsim.load")
    shapes, kind = _shapes(model), _number_type(model)
    for name in () if model.nhistory else DELAYS:
        if getattr(model, name) is not None:
            raise ValueError(f"model.{name} must be None: the model was loaded without delays")
    opt = _admitted(model.opt, shapes["opt"], kind, "model.opt")
    stat = _admitted(model.stat, shapes["stat"], kind, "model.stat")
    if not isinstance(opt.timestep, jax.core.Tracer) and not np.asarray(opt.timestep) > 0:
        raise ValueError(f"model.opt.timestep must be positive, got {np.asarray(opt.timestep)}")
    model = _admitted(model, shapes["model"], kind, "model")
    if opt is not model.opt or stat is not model.stat:
        model = dataclasses.replace(model, opt=opt, stat=stat)
    return model


def admit_array(model: Model, value: Any, shape: Shape, name: str) -> jax.Array:
    """Validate an array, and convert it to the model's number type.

    Args:
      model: the model.
      value: the array.
      shape: the expected shape; None stands for any length.
      name: its name in messages.

    Raises:
      TypeError: it is not an array of floating-point numbers.
      ValueError: it has the wrong shape.
    """
    array, kind = _array(value, shape, name), _number_type(model)
    if array.dtype == kind and isinstance(array, jax.Array):
        return array
    if not jnp.issubdtype(array.dtype, jnp.floating):
        raise TypeError(f"{name} must be of type {kind}, got {array.dtype}")
    return jnp.asarray(array, kind)


def _number_type(model: Model) -> np.dtype:
    """The dtype of a model's numbers; a TypeError if JAX cannot compute with it."""
    kind = np.dtype(jnp.result_type(model.body_pos))
    if not jnp.issubdtype(kind, jnp.floating):
        raise TypeError(f"model.body_pos must be of a floating-point type, got {kind}")
    if kind == np.float64 and jnp.result_type(float) != kind:
        raise TypeError(
            "the model's numbers are float64, which JAX has switched off since it was loaded; "
            "switch jax_enable_x64 on, or load the model again"
        )
    return kind


def _admitted(record: Record, shapes: dict[str, Shape], kind: np.dtype, name: str) -> Record:
    """The record with its fields converted to these shapes and this type."""
    changes = {}
    for field, shape in shapes.items():
        value = getattr(record, field)
        right = isinstance(value, jax.Array) and value.dtype == kind and value.shape == shape
        if not right or value.weak_type:
            changes[field] = _converted(value, shape, kind, f"{name}.{field}")
    return dataclasses.replace(record, **changes) if changes else record  # type: ignore[type-var]


def _converted(value: Any, shape: Shape, kind: np.dtype, name: str) -> jax.Array:
    """Python numbers or a NumPy array as a JAX array; a JAX array must already have the type."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = np.asarray(value, kind)
    array = _array(value, shape, name)
    free = not isinstance(array, jax.Array) or array.weak_type
    if not jnp.issubdtype(array.dtype, jnp.floating) or (array.dtype != kind and not free):
        raise TypeError(
            f"{name} must be of type {kind}, as the model's numbers are, got {array.dtype}; load "
            "the model after switching to another precision, or convert the array"
        )
    if isinstance(array, jax.core.Tracer):
        return jax.lax.convert_element_type(array, kind)
    with jax.ensure_compile_time_eval():  # else it would become a tracer in a traced function
        return jnp.asarray(array, kind)


def _array(value: Any, shape: Shape, name: str) -> jax.Array | np.ndarray:
    """Return the value if it is an array of this shape, else raise."""
    if not isinstance(value, jax.Array | np.ndarray | np.generic):
        raise TypeError(f"{name} must be an array, got {type(value).__name__}")
    fits = len(value.shape) == len(shape)
    if not fits or any(n not in (None, m) for n, m in zip(shape, value.shape, strict=True)):
        expected = ", ".join("any" if n is None else str(n) for n in shape)
        comma = "," if len(shape) == 1 else ""
        raise ValueError(
            f"{name} must have shape ({expected}{comma}), got {value.shape}; batches go through "
            "jax.vmap or jaxsim.vmap"
        )
    return value  # type: ignore[return-value]


@fact()
def _shapes(model: Model) -> dict[str, dict[str, Shape]]:
    """Shapes of the arrays of each record, from their annotations and the model's sizes."""
    records = {"model": Model, "opt": Option, "stat": Statistic, "state": State}
    absent = () if model.nhistory else (*DELAYS, "history")
    return {
        name: {
            field: tuple(_length(model, axis) for axis in axes.split())
            for field, axes in _annotated(record)
            if field not in absent
        }
        for name, record in records.items()
    }


@functools.cache
def _annotated(record: type) -> tuple[tuple[str, str], ...]:
    """Fields that are arrays, and their axes."""
    hints = typing.get_type_hints(record)
    return tuple((name, h.dim_str) for name, h in hints.items() if hasattr(h, "dim_str"))


def _length(model: Model, axis: str) -> int:
    """Length of an axis that is annotated as a number, a size of the model, or their product."""
    sizes = {"npoly": int(mujoco.mjNPOLY)}
    return math.prod(
        int(factor) if factor.isdigit() else sizes.get(factor) or getattr(model, factor)
        for factor in axis.split("*")
    )
