"""Names of a model's elements: from name to id, and from id to name."""

import difflib
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import mujoco

# Kinds of elements, and their part of the field `name_*adr` in MuJoCo's model.
KINDS = {
    "body": "body",
    "joint": "jnt",
    "geom": "geom",
    "site": "site",
    "camera": "cam",
    "pair": "pair",
    "exclude": "exclude",
    "equality": "eq",
    "tendon": "tendon",
    "actuator": "actuator",
    "sensor": "sensor",
    "key": "key",
}
_DEEPEST = 3  # most elements in the label of an element without a name

Label = Callable[[str, int], str]
Element = tuple[str, int]


class Names:
    """The names of every kind of element.

    Example:
      >>> model.names.id("joint", "knee")
      3
      >>> model.names.name("joint", 3)
      'knee'
    """

    def __init__(
        self,
        names: dict[str, tuple[str, ...]],
        owners: Mapping[str, Sequence[Element | None]] | None = None,
    ):
        self._names, self._owners = names, owners or {}
        self._ids = {k: {n: i for i, n in enumerate(v) if n} for k, v in names.items()}
        self.key = tuple(sorted(names.items()))

    @classmethod
    def from_mujoco(cls, mj: mujoco.MjModel) -> "Names":
        """Read all names of a compiled model."""
        names = {
            kind: tuple(_decoded(mj.names, a) for a in getattr(mj, f"name_{prefix}adr"))
            for kind, prefix in KINDS.items()
        }
        return cls(names, _owners(mj))

    def of(self, kind: str) -> tuple[str, ...]:
        """All names of a kind in the order of ids; an empty string for an unnamed element.

        Raises:
          KeyError: the kind does not exist.
        """
        if kind not in self._names:
            raise KeyError(
                f"no kind of element is called {kind!r}; the kinds are {', '.join(KINDS)}"
            )
        return self._names[kind]

    def id(self, kind: str, name: str) -> int:
        """The id of the element with this name.

        Raises:
          KeyError: the kind or the name does not exist; the message lists near matches.
        """
        self.of(kind)
        ids = self._ids[kind]
        if name not in ids:
            raise KeyError(
                f"the model has no {kind} named {name!r}; {_suggestion(name, list(ids))}"
            )
        return ids[name]

    def name(self, kind: str, index: int) -> str:
        """The name of the element with this id, or an empty string if it has none.

        Raises:
          KeyError: the kind does not exist.
          IndexError: there is no element with this id.
        """
        names = self.of(kind)
        if not 0 <= index < len(names):
            raise IndexError(
                f"the model has {len(names)} elements of kind {kind!r}, got id {index}"
            )
        return names[index]

    def label(self, kind: str, index: int) -> str:
        """An element in a message: its kind and name, or its number and the element it is part of.

        Example:
          >>> model.names.label("geom", 7)
          "geom number 7 of body 'foot'"
        """
        parts = []
        element: Element | None = (kind, index)
        while element and len(parts) < _DEEPEST:
            kind, index = element
            name = self.name(kind, index)
            parts.append(f"{kind} {name!r}" if name else f"{kind} number {index}")
            element = None if name or kind not in self._owners else self._owners[kind][index]
        return " of ".join(parts)


def _decoded(names: bytes, start: int) -> str:
    """The name at an address, in UTF-8 or else in Latin-1, in which every byte is a letter."""
    raw = names[start : names.index(b"\0", start)]
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("latin-1")


def _owners(mj: mujoco.MjModel) -> dict[str, list[Element | None]]:
    """For each kind, the element to which each element belongs or on which it acts."""
    bodies = {"body": mj.body_parentid, "joint": mj.jnt_bodyid, "geom": mj.geom_bodyid}
    bodies |= {"site": mj.site_bodyid, "camera": mj.cam_bodyid}
    owners: dict[str, list[Any]] = {
        kind: [("body", int(b)) for b in ids] for kind, ids in bodies.items()
    }
    owners["body"] = [body if body[1] else None for body in owners["body"]]
    owners["pair"] = [("geom", int(g)) for g in mj.pair_geom1]
    owners["equality"] = _objects(
        [_EQUALITIES.get(int(e), int(o)) for e, o in zip(mj.eq_type, mj.eq_objtype, strict=True)],
        mj.eq_obj1id,
    )
    owners["sensor"] = _objects(mj.sensor_objtype, mj.sensor_objid)
    owners["actuator"] = _objects(
        [_driven(*pair) for pair in zip(mj.actuator_trntype, mj.actuator_trnid[:, 1], strict=True)],
        mj.actuator_trnid[:, 0],
    )
    return owners


def _driven(kind: int, reference: int) -> int:
    """What an actuator acts on, a number of `mujoco.mjtObj`; -1 if it is unknown."""
    if kind == _SO3:
        return _JOINT if reference < 0 else _SITE
    return _TRANSMISSIONS.get(int(kind), -1)


def _objects(types: Sequence[int], ids: Sequence[int]) -> list[Element | None]:
    found = [(_OBJECTS.get(int(t)), int(i)) for t, i in zip(types, ids, strict=True)]
    return [(kind, i) if kind and i >= 0 else None for kind, i in found]


_OBJECTS = {
    int(getattr(mujoco.mjtObj, f"mjOBJ_{name}")): kind
    for name, kind in {
        **{kind.upper(): kind for kind in ("body", "joint", "geom", "site", "camera", "tendon")},
        "XBODY": "body",
        "ACTUATOR": "actuator",
    }.items()
}
_JOINT, _SITE = int(mujoco.mjtObj.mjOBJ_JOINT), int(mujoco.mjtObj.mjOBJ_SITE)
_SO3 = int(mujoco.mjtTrn.mjTRN_SO3)
# Types of equalities for which `eq_objtype` does not say what their objects are.
_EQUALITIES = {
    int(getattr(mujoco.mjtEq, f"mjEQ_{name}")): int(getattr(mujoco.mjtObj, f"mjOBJ_{name}"))
    for name in ("JOINT", "TENDON")
}
_TRANSMISSIONS = {
    int(getattr(mujoco.mjtTrn, f"mjTRN_{name}")): int(getattr(mujoco.mjtObj, f"mjOBJ_{obj}"))
    for name, obj in {
        "JOINT": "JOINT",
        "JOINTINPARENT": "JOINT",
        "TENDON": "TENDON",
        "SITE": "SITE",
        "BODY": "BODY",
        "SLIDERCRANK": "SITE",
    }.items()
}


def _suggestion(name: str, known: list[str]) -> str:
    near = difflib.get_close_matches(name, known, n=3)
    if near:
        return "did you mean " + " or ".join(repr(n) for n in near) + "?"
    return "its names are " + (", ".join(known[:12]) or "all empty")
