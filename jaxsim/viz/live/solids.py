"""Triangles of MuJoCo's shapes."""

from typing import Any

import numpy as np

from jaxsim.viz.drawing import Drawing, Surface


def solid(geom: dict[str, Any], drawn: Drawing) -> Surface:
    """Triangles of a geom of a drawing, in its frame; a plane without end is 40 radii wide."""
    kind, size = geom["type"], np.asarray(geom["size"], float)
    if kind == "surface":
        return drawn.surfaces[geom["surface"]]
    if kind == "plane":
        return _sheet(*np.where(size[:2] > 0, size[:2], 40 * drawn.extent))
    if kind == "box":
        return _box(size)
    profile = {
        "sphere": lambda: _arc(size[0], 0.0),
        "ellipsoid": lambda: _arc(1.0, 0.0),
        "capsule": lambda: _arc(size[0], size[1]),
        "cylinder": lambda: np.array([[0, 1], [size[0], 1], [size[0], -1], [0, -1]]) * [1, size[1]],
    }[kind]()
    turned = _turned(profile)
    return Surface(turned.points * size, turned.faces) if kind == "ellipsoid" else turned


def _arc(radius: float, half: float, steps: int = 8) -> np.ndarray:
    """(n, 2) distance from the axis and height, from pole to pole of a capsule."""
    angle = np.linspace(0, np.pi / 2, steps)
    top = np.stack([radius * np.sin(angle), half + radius * np.cos(angle)], axis=1)
    return np.concatenate([top, top[::-1] * [1, -1]])


def _turned(profile: np.ndarray, around: int = 24) -> Surface:
    """A profile (n, 2), from above, turned about z."""
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    ring = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    flat = profile[:, None, :1] * ring
    high = np.broadcast_to(profile[:, None, 1:], (len(profile), around, 1))
    points = np.concatenate([flat, high], axis=-1).reshape(-1, 3)
    rows, columns = np.meshgrid(np.arange(len(profile) - 1), np.arange(around), indexing="ij")
    a = rows * around + columns
    b = rows * around + (columns + 1) % around
    faces = np.stack([a, a + around, b, b, a + around, b + around], axis=-1).reshape(-1, 3)
    return Surface(points, faces)


def _box(size: np.ndarray) -> Surface:
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    sides = [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
    faces = [[s[0], s[i], s[i + 1]] for s in sides for i in (1, 2)]
    return Surface(signs * size, np.array(faces))


def _sheet(x: float, y: float) -> Surface:
    points = np.array([[-x, -y, 0], [x, -y, 0], [x, y, 0], [-x, y, 0]], float)
    return Surface(points, np.array([[0, 1, 2], [0, 2, 3]]))
