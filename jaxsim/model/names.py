"""Names of a model's elements, looked up both ways."""

import difflib

import mujoco

KINDS = {
    "body": "nbody",
    "joint": "njnt",
    "geom": "ngeom",
    "site": "nsite",
    "camera": "ncam",
    "pair": "npair",
    "exclude": "nexclude",
    "equality": "neq",
    "tendon": "ntendon",
    "actuator": "nactuator",
    "sensor": "nsensor",
    "key": "nkey",
}


class Names:
    """The names of every kind of element.

    Example:
      >>> model.names.id("joint", "knee")
      3
      >>> model.names.name("joint", 3)
      'knee'
    """

    def __init__(self, names: dict[str, tuple[str, ...]]):
        self._names = names
        self._ids = {k: {n: i for i, n in enumerate(v) if n} for k, v in names.items()}
        self.key = tuple(sorted(names.items()))

    @classmethod
    def from_mujoco(cls, mj: mujoco.MjModel) -> "Names":
        """Read all names of a compiled model."""
        return cls(
            {
                kind: tuple(
                    mujoco.mj_id2name(mj, getattr(mujoco.mjtObj, f"mjOBJ_{kind.upper()}"), i) or ""
                    for i in range(getattr(mj, size))
                )
                for kind, size in KINDS.items()
            }
        )

    def of(self, kind: str) -> tuple[str, ...]:
        """All names of a kind in the order of their ids; unnamed elements are empty strings.

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
        """How a message refers to an element: its kind with its name, or with its number."""
        name = self.name(kind, index)
        return f"{kind} {name!r}" if name else f"{kind} number {index}"


def _suggestion(name: str, known: list[str]) -> str:
    near = difflib.get_close_matches(name, known, n=3)
    if near:
        return "did you mean " + " or ".join(repr(n) for n in near) + "?"
    return "its names are " + (", ".join(known[:12]) or "all empty")
