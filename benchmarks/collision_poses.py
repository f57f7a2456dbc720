"""Models of two geoms, and random poses of these at wanted distances."""

import itertools
from collections.abc import Callable

import mujoco
import numpy as np

SHAPES = ("plane", "hfield", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh")
PAIRS = tuple(
    (a, b)
    for a, b in itertools.combinations_with_replacement(SHAPES, 2)
    if b not in ("plane", "hfield")
)
SIZES = {
    "plane": "0 0 1",
    "sphere": ".11",
    "capsule": ".07 .15",
    "ellipsoid": ".08 .12 .17",
    "cylinder": ".09 .12",
    "box": ".08 .11 .14",
}
# Beyond the largest distance of `near`, so that contacts exist there.
MARGIN, FAR_MARGIN = 0.02, 2.0
# Distances (m) of each kind of pose, the lowest and the highest; deep ones are relative to 0.1 m.
REGIMES = {
    "near": (1e-4, 1e-2),
    "touching": (-1e-5, 1e-5),
    "deep": (-0.06, -0.004),
    "far": (0.05, 1.0),
}


def model(names: tuple[str, str], margin: float) -> mujoco.MjModel:
    """Two geoms and a <pair> of them; MuJoCo's search is as precise as it can be."""
    rng = np.random.default_rng(1)
    direction = rng.normal(size=(12, 3))
    direction *= 0.12 / np.linalg.norm(direction, axis=1, keepdims=True)
    hull = " ".join(f"{x:.4f}" for x in direction.ravel())
    heights = " ".join(f"{x:.3f}" for x in rng.random(25))
    geoms = [
        f'<geom name="{i}" type="{name}" contype="0" conaffinity="0" {_size(name)}/>'
        for i, name in enumerate(names)
    ]
    xml = f"""<mujoco><option ccd_tolerance="1e-15" ccd_iterations="1000"/>
      <asset><mesh name="mesh" vertex="{hull}"/>
        <hfield name="hfield" nrow="5" ncol="5" size=".6 .6 .1 .1" elevation="{heights}"/></asset>
      <worldbody>{geoms[0]}<body><freejoint/>{geoms[1]}<inertial pos="0 0 0" mass="1"
        diaginertia="1 1 1"/></body></worldbody>
      <contact><pair geom1="0" geom2="1" margin="{margin}"/></contact></mujoco>"""
    return mujoco.MjModel.from_xml_string(xml)


def _size(name: str) -> str:
    return f'{name}="{name}"' if name in ("mesh", "hfield") else f'size="{SIZES[name]}"'


def rotations(rng: np.random.Generator, count: int) -> np.ndarray:
    """(count, 3, 3) random rotations."""
    a, b, c, d = np.moveaxis(_unit(rng.normal(size=(count, 4))), 1, 0)
    rows = [
        [a * a + b * b - c * c - d * d, 2 * (b * c - a * d), 2 * (b * d + a * c)],
        [2 * (b * c + a * d), a * a - b * b + c * c - d * d, 2 * (c * d - a * b)],
        [2 * (b * d - a * c), 2 * (c * d + a * b), a * a - b * b - c * c + d * d],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _unit(x: np.ndarray) -> np.ndarray:
    return x / np.linalg.norm(x, axis=-1, keepdims=True)


def random_poses(names, rng, count: int):
    """Positions, rotations, and directions (n, 3) along which the second geom is moved."""
    mat = np.stack([rotations(rng, count), rotations(rng, count)], axis=1)
    return _placed(names, rng, mat, _unit(rng.normal(size=(count, 3))))


def aligned_poses(names, rng, count: int):
    """The same with axes that are parallel or at right angles up to small tilts."""
    common, turns = rotations(rng, count), _quarter_turns()
    second = common @ turns[rng.integers(len(turns), size=count)]
    tilt = rng.choice([0.0, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3], size=count)
    axis = _unit(rng.normal(size=(count, 3)))
    skew = np.cross(axis[:, None], np.eye(3)).swapaxes(1, 2)
    sine, versine = np.sin(tilt)[:, None, None], (1 - np.cos(tilt))[:, None, None]
    tilted = (np.eye(3) + sine * skew + versine * skew @ skew) @ second
    axes = np.eye(3)[rng.integers(3, size=count)] * rng.choice([-1, 1], size=(count, 1))
    along = np.einsum("nij,nj->ni", common, axes)
    return _placed(names, rng, np.stack([common, tilted], axis=1), along)


def _quarter_turns() -> np.ndarray:
    signed = [np.eye(3)[list(p)] for p in itertools.permutations(range(3))]
    turned = [m * s for m in signed for s in itertools.product((-1, 1), repeat=3)]
    half = np.array([[1, -1, 0], [1, 1, 0], [0, 0, np.sqrt(2)]]) / np.sqrt(2)
    right = [m for m in turned if np.linalg.det(m) > 0]
    return np.array([*right, *(half @ m for m in right)])


def _placed(names, rng, mat, along):
    count = len(mat)
    pos = np.zeros((count, 2, 3))
    sideways = rng.uniform(-0.04, 0.04, (count, 3))
    if names[0] in ("plane", "hfield"):
        along = mat[:, 0, :, 2]
        sideways = np.einsum("nij,nj->ni", mat[:, 0, :, :2], rng.uniform(-0.35, 0.35, (count, 2)))
    pos[:, 0] = rng.uniform(-0.5, 0.5, (count, 3))
    pos[:, 1] = pos[:, 0] + sideways + 0.3 * along
    return pos, mat, along


def move_to(target: np.ndarray, poses, contacts: Callable, iterations: int = 15):
    """Move the second geoms along their directions until they have wanted distances.

    Args:
      target: (n,) distances.
      poses: positions, rotations, directions.
      contacts: function of positions and rotations to distances (n, k) and normals (n, k, 3).
    """
    pos, mat, along = poses
    pos = pos.copy()
    for _ in range(iterations):
        dist, normal = contacts(pos, mat)
        deepest = np.argmin(dist, axis=1)
        rows = np.arange(len(dist))
        slope = np.sum(normal[rows, deepest] * along, axis=1)
        step = (target - dist[rows, deepest]) / np.where(np.abs(slope) > 0.2, slope, 1)
        pos[:, 1] += np.clip(step, -0.3, 0.3)[:, None] * along
    return pos, mat
