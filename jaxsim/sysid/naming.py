"""Names of numbers in a model: `field[element, component]`.

`body_mass[brick]`, `geom_friction[brick, 0]`, `dof_damping[knee]`, `opt.gravity[2]`. The field is
a leaf of `Model`, or of its options after `opt.`. The element is a name, a number, or a pattern
such as `*` or `leg_*`; elements of `dof_` and `qpos` fields are joints. Components are numbers of
what an element has more than one of; without them all of it is meant.
"""

import fnmatch
import re
from typing import NamedTuple

import jax
import numpy as np

from jaxsim.model import Model
from jaxsim.model.structure import ACTUATOR_ROWS
from jaxsim.sysid.errors import SysidError

_NAME = re.compile(r"(?P<field>(opt\.)?\w+)(\[(?P<inside>[^\]]*)\])?")
_KINDS = {
    "body": "body",
    "jnt": "joint",
    "dof": "joint",
    "qpos0": "joint",
    "qpos": "joint",
    "geom": "geom",
    "site": "site",
    "pair": "pair",
    "eq": "equality",
    "tendon": "tendon",
    "actuator": "actuator",
}


class Entries(NamedTuple):
    """Numbers of one leaf.

    Attributes:
      field: name of the leaf.
      index: (n, ndim) their indices.
      labels: a full name for each.
    """

    field: str
    index: np.ndarray
    labels: tuple[str, ...]

    def read(self, model: Model) -> jax.Array:
        """(n,) the numbers."""
        return leaf(model, self.field)[tuple(self.index.T)]

    def write(self, model: Model, values: jax.Array) -> Model:
        """The model with other numbers."""
        changed = leaf(model, self.field).at[tuple(self.index.T)].set(values)
        if self.field.startswith("opt."):
            return model.replace(opt=model.opt.replace(**{self.field[4:]: changed}))
        return model.replace(**{self.field: changed})


def leaf(model: Model, field: str) -> jax.Array:
    """A leaf of the model or of its options."""
    record, _, name = field.rpartition(".")
    return getattr(model.opt if record else model, name)


def entries(model: Model, name: str) -> Entries:
    """What a name means.

    Raises:
      SysidError: it means nothing.
    """
    field, element, components = parsed(name)
    array = _checked_leaf(model, field)
    if field.startswith("opt."):
        components = [*([element] if element is not None else []), *components]
        grid = np.array(list(np.ndindex(*array.shape)), int)
        blocks = [("", grid.reshape(*array.shape, array.ndim))]
    else:
        kind = _kind(field)
        blocks = [
            (_plain(model, kind, i), _indices(model, field, array, i))
            for i in matching(model, kind, element)
        ]
    found = [pair for label, grid in blocks for pair in _chosen(name, label, grid, components)]
    index = np.array([i for _, i in found], int).reshape(len(found), array.ndim)
    return Entries(field, index, tuple(f"{field}{label}" for label, _ in found))


def parsed(name: str) -> tuple[str, str | None, list[str]]:
    """Field, element and components of a name."""
    match = _NAME.fullmatch(name.strip())
    if not match:
        raise SysidError(f"{name!r} is no name of a parameter; write field[element, component]")
    inside = match["inside"]
    parts = [] if inside is None else [p.strip().strip("'\"") for p in inside.split(",")]
    return match["field"], parts[0] if parts else None, parts[1:]


def matching(model: Model, kind: str, element: str | None) -> list[int]:
    """Ids of the elements that a name, a number or a pattern means."""
    names = model.names.of(kind)
    if element is None or element == "*":
        return list(range(len(names)))
    if element in names and element:
        return [names.index(element)]
    if element.isdigit() and int(element) < len(names):
        return [int(element)]
    found = [i for i, n in enumerate(names) if n and fnmatch.fnmatchcase(n, element)]
    if not found:
        known = ", ".join(n or str(i) for i, n in enumerate(names[:12]))
        raise SysidError(f"the model has no {kind} named {element!r}; its {kind} names are {known}")
    return found


def _checked_leaf(model: Model, field: str) -> jax.Array:
    try:
        array = leaf(model, field)
    except AttributeError:
        array = None
    if not isinstance(array, jax.Array) or not np.issubdtype(array.dtype, np.floating):
        raise SysidError(
            f"a model has no numbers called {field!r}; its leaves are the fields of jaxsim.Model, "
            "such as body_mass, geom_friction, dof_damping, and of its options, such as opt.gravity"
        )
    return array


def _kind(field: str) -> str:
    prefix = field if field in _KINDS else field.split("_")[0]
    if prefix not in _KINDS:
        raise SysidError(f"{field} does not belong to elements with names and cannot be fitted")
    return _KINDS[prefix]


def _plain(model: Model, kind: str, i: int) -> str:
    return model.names.name(kind, i) or str(i)


def _indices(model: Model, field: str, array: jax.Array, i: int) -> np.ndarray:
    """(..., ndim) indices of all numbers of an element; its shape is that of its part."""
    rows = np.array([i])
    if field.startswith("dof"):
        (rows,) = np.nonzero(model.dof_jntid == i)
    elif field.startswith("qpos"):
        ends = [*model.jnt_qposadr, model.nq]
        rows = np.arange(ends[i], ends[i + 1])
    elif field in ACTUATOR_ROWS:
        owner = np.repeat(np.arange(model.nactuator), getattr(model, ACTUATOR_ROWS[field]))
        (rows,) = np.nonzero(owner == i)
    grid = np.stack(np.meshgrid(rows, *map(np.arange, array.shape[1:]), indexing="ij"), axis=-1)
    return grid[0] if len(rows) == 1 else grid


def _chosen(name: str, label: str, grid: np.ndarray, components: list[str]):
    """(label, index) of the numbers that components choose from an element's."""
    shape = grid.shape[:-1]
    if len(components) > len(shape):
        raise SysidError(f"{name!r} has more components than the element has axes, {len(shape)}")
    wanted = []
    for text, size in zip(components, shape, strict=False):
        if not text.isdigit() or int(text) >= size:
            raise SysidError(f"{name!r}: {text!r} is none of the components 0 to {size - 1}")
        wanted.append(int(text))
    for at in np.ndindex(*shape):
        if list(at[: len(wanted)]) == wanted:
            parts = [p for p in (label, *map(str, at)) if p]
            yield (f"[{', '.join(parts)}]" if parts else ""), grid[at]
