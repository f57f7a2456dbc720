"""Which numbers of a model are fitted, and in which coordinates."""

import dataclasses
import math
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.io import set_const
from jaxsim.model import Model
from jaxsim.sysid.errors import SysidError
from jaxsim.sysid.inertia import COMPONENTS, from_log_cholesky, to_log_cholesky
from jaxsim.sysid.naming import entries, matching, parsed

# Beginnings of fields that are positive by their nature, and are fitted by their logarithms.
_POSITIVE = (
    *("body_mass", "body_inertia", "dof_armature", "dof_damping", "dof_frictionloss"),
    *("jnt_stiffness", "geom_friction", "geom_size", "geom_solref", "pair_friction"),
    *("tendon_stiffness", "tendon_damping", "tendon_frictionloss", "opt.density", "opt.viscosity"),
)
# Beginnings of fields on which derived constants depend.
_SET_CONST = (
    "body_",
    "dof_armature",
    "jnt_pos",
    "jnt_axis",
    "qpos0",
    "inertia",
    "mass",
    "actuator_gear",
)


@dataclasses.dataclass(frozen=True)
class Parameter:
    """A number, or several, to be fitted.

    Attributes:
      name: `field[element, component]`, see `jaxsim.sysid.naming`; or `mass[body]`, with which the
        body's inertia grows; or `inertia[body]`, which are mass, centre of mass and rotational
        inertia in log-Cholesky coordinates.
      start: first guess; None is the model's number.
      prior: standard deviation of the prior about the model's number, relative for positive
        numbers; None for no prior.
      spread: standard deviation of the first guesses if there are many, relative for positive
        numbers.
      positive: whether the logarithm is fitted; None says so for masses, damping, friction and the
        like.
      tied: whether all numbers of this name are one.
    """

    name: str
    start: float | None = None
    prior: float | None = None
    spread: float = 0.3
    positive: bool | None = None
    tied: bool = False


@dataclasses.dataclass(frozen=True)
class Block:
    """Coordinates of one parameter.

    Attributes:
      labels: a name for each coordinate.
      center: what they are in the model.
      start: where they begin.
      prior: standard deviation of each, infinite without a prior.
      spread: standard deviation of first guesses.
      scale: size of a relative change of one; for linear numbers their own size.
      logarithmic: whether a number is the exponential of its coordinate.
      write: from a model and coordinates to the changed model.
    """

    labels: tuple[str, ...]
    center: np.ndarray
    start: np.ndarray
    prior: np.ndarray
    spread: np.ndarray
    scale: np.ndarray
    logarithmic: bool
    write: Callable[[Model, jax.Array], Model]


class ParameterSet:
    """All parameters as one vector of coordinates.

    Args:
      model: the model before identification.
      parameters: names, or `Parameter` where more is to be said.

    Raises:
      SysidError: a name means nothing, or a first guess is impossible.
    """

    def __init__(self, model: Model, parameters: Sequence[Parameter | str]):
        if not parameters:
            raise SysidError("there are no parameters to fit")
        wanted = [Parameter(p) if isinstance(p, str) else p for p in parameters]
        self.base = model
        self.blocks = [_block(model, p) for p in wanted]
        self._set_const = any(p.name.startswith(_SET_CONST) for p in wanted)
        self.labels = tuple(label for b in self.blocks for label in b.labels)
        twice = {name for name in self.labels if self.labels.count(name) > 1}
        if twice:
            raise SysidError(f"{', '.join(sorted(twice))} would be fitted twice")

    def stacked(self, name: str) -> Float[Array, "p"]:
        """One of the blocks' fields for all coordinates."""
        values = np.concatenate([getattr(b, name) for b in self.blocks])
        return jnp.asarray(values, self.base.body_mass.dtype)

    @property
    def logarithmic(self) -> np.ndarray:
        """(p,) which numbers are exponentials of their coordinates."""
        return np.concatenate([np.full(len(b.labels), b.logarithmic) for b in self.blocks])

    def model(self, x: Float[Array, "p"]) -> Model:
        """The model for given coordinates, with the constants that depend on them."""
        changed, ends = self.base, np.cumsum([len(b.labels) for b in self.blocks])
        for block, end in zip(self.blocks, ends, strict=True):
            changed = block.write(changed, x[end - len(block.labels) : end])
        return set_const(changed) if self._set_const else changed

    def values(self, x: Float[Array, "p"]) -> Float[Array, "p"]:
        """The numbers themselves."""
        return jnp.where(self.logarithmic, jnp.exp(x), x)


def _block(model: Model, wanted: Parameter) -> Block:
    field, element, _ = parsed(wanted.name)
    if field == "inertia":
        return _inertia_block(model, wanted, element)
    if field == "mass":
        return _mass_block(model, wanted, element)
    return _entries_block(model, wanted)


def _entries_block(model: Model, wanted: Parameter) -> Block:
    found = entries(model, wanted.name)
    numbers = np.asarray(found.read(model), float)
    labels = found.labels
    if wanted.tied:
        numbers, labels = numbers[:1], (wanted.name,)
    count = len(found.labels)
    start = np.full(len(numbers), wanted.start) if wanted.start is not None else numbers
    positive = wanted.positive
    if positive is None:
        positive = wanted.name.startswith(_POSITIVE) and not (start < 0).any()
    if positive and not ((start > 0).all() and np.isfinite(start).all()):
        raise SysidError(
            f"{wanted.name} starts at {start.min():g}, but the logarithm of a positive number is "
            "fitted; give a start above zero, or positive=False"
        )
    center = np.where(numbers > 0, numbers, start) if positive else numbers

    def write(model, x):
        x = jnp.exp(x) if positive else x
        return found.write(model, jnp.broadcast_to(x, (count,)) if wanted.tied else x)

    size = np.where(np.abs(start) > 0, np.abs(start), 1.0)
    return Block(
        labels=labels,
        center=np.log(center) if positive else center,
        start=np.log(start) if positive else start,
        scale=np.ones(len(start)) if positive else size,
        logarithmic=positive,
        write=write,
        **_widths(wanted, len(start)),
    )


def _inertia_block(model: Model, wanted: Parameter, element: str | None) -> Block:
    bodies = matching(model, "body", element)
    if len(bodies) != 1 or wanted.start is not None:
        raise SysidError(f"{wanted.name!r} must name one body, and starts at its inertia")
    (body,) = bodies
    x, length = to_log_cholesky(model, body)
    name = model.names.name("body", body) or str(body)
    return Block(
        labels=tuple(f"inertia[{name}, {c}]" for c in COMPONENTS),
        center=np.asarray(x),
        start=np.asarray(x),
        scale=np.ones(10),
        logarithmic=False,
        write=lambda model, x: from_log_cholesky(model, body, x, length),
        **_widths(wanted, 10),
    )


def _mass_block(model: Model, wanted: Parameter, element: str | None) -> Block:
    """The mass of a body whose radii of gyration are known."""
    block = _entries_block(model, dataclasses.replace(wanted, name=f"body_{wanted.name}"))
    bodies = np.array(matching(model, "body", element))
    per_mass = model.body_inertia[bodies] / model.body_mass[bodies][:, None]

    def write(model, x):
        inertia = model.body_inertia.at[bodies].set(jnp.exp(x)[:, None] * per_mass)
        return block.write(model.replace(body_inertia=inertia), x)

    labels = tuple(label.removeprefix("body_") for label in block.labels)
    return dataclasses.replace(block, labels=labels, write=write)


def _widths(wanted: Parameter, count: int) -> dict[str, np.ndarray]:
    prior = math.inf if wanted.prior is None else wanted.prior
    if not prior > 0 or not wanted.spread >= 0:
        raise SysidError(f"{wanted.name}: prior and spread are standard deviations")
    return {"prior": np.full(count, prior), "spread": np.full(count, wanted.spread)}
