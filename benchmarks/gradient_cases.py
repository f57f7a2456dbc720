"""Motions through contact whose derivatives are known: two scenes, and the cases in them.

A mass slides along x and z above a plane; two balls move in a plane. What a motion depends on is a
vector of numbers, so that one compiled program has all cases of a scene.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import gradient_truths as truths
import numpy as np
from gradient_truths import RADIUS, G

# Friction of zero is a NaN in MJX.
LEAST = 1e-5
CONTACT = """<option cone="elliptic" tolerance="0" iterations="50" ls_iterations="50"/>
<default><geom solimp=".95 .95 .001"/></default>"""
SLIDER = f"""<mujoco>{CONTACT}<worldbody><geom type="plane" size="0 0 1"/>
<body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
<geom size="{RADIUS}" contype="0"/></body></worldbody></mujoco>"""
SLIDES = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>'
# MuJoCo's broad phase keeps these sizes, so that they are the largest.
BALLS = f"""<mujoco>{CONTACT}<worldbody><body>{SLIDES}<geom size="{2 * RADIUS}" condim="1"/></body>
<body>{SLIDES}<geom size="{2 * RADIUS}" condim="1"/></body></worldbody></mujoco>"""


class Scene(NamedTuple):
    """A model, and what its motion depends on, with values to begin from."""

    xml: str
    inputs: dict[str, float]


SCENES = {
    "slider": Scene(
        SLIDER, {"x": 0, "z": 1, "vx": 0, "vz": 0, "mu": LEAST, "e": 0, "g": G, "theta": 0, "m": 1}
    ),
    "balls": Scene(
        BALLS,
        dict.fromkeys(("x1", "y1", "x2", "y2", "v1", "u1", "v2", "u2"), 0)
        | {"e": 1, "m1": 1, "m2": 1, "radius": RADIUS},
    ),
}


def placed(inputs, xp) -> dict:
    """The arrays that the inputs of a scene decide, under MuJoCo's names.

    Args:
      inputs: vector of the numbers that the scene names.
      xp: numpy or jax.numpy.
    """
    if len(inputs) == len(SCENES["slider"].inputs):
        x, z, vx, vz, mu, e, g, theta, m = inputs
        masses, gravity = [0 * m, m], [g * xp.sin(theta), 0 * g, -g * xp.cos(theta)]
        position, velocity, radii = [x, z], [vx, vz], [0 * m, RADIUS + 0 * m]
    else:
        *motion, e, m1, m2, radius = inputs
        position, velocity, masses = motion[:4], motion[4:], [0 * m1, m1, m2]
        gravity, radii, mu = [0 * e] * 3, [radius, radius], LEAST + 0 * e
    # The regularisation of contacts has the true inertia of what slides.
    weights = [[0 * m, 0 * m] if i == 0 else [1 / m, 0 * m] for i, m in enumerate(masses)]
    values = {
        "qpos": position,
        "qvel": velocity,
        "gravity": gravity,
        "body_mass": masses,
        "body_invweight0": weights,
        "geom_friction": [[mu, 0 * mu, 0 * mu]] * 2,
        "geom_restitution": [e, e],
        "geom_rbound": radii,
        "geom_size": [[r, 0 * r, 0 * r] for r in radii],
    }
    stack = lambda v: xp.stack([stack(x) for x in v]) if isinstance(v, list) else v  # noqa: E731
    return {name: stack(value) for name, value in values.items()}


class Case(NamedTuple):
    """A motion, and derivatives of where it ends.

    Attributes:
      name: of the case.
      scene: name of its scene.
      start: inputs that are not the scene's.
      duration: of the motion (s).
      end: index of the final position.
      truth: function of (inputs by name, solref, duration); rigid if solref is None.
      table: the final position under "", and derivatives by inputs, as published.
      solref: of the soft contacts; stiff where rigid ones are meant.
      steps: time steps with soft contact (s).
      shift: an input by whose change the phase of contact changes, and by how much in a second.
      rigid: whether rigid contact is meant.
    """

    name: str
    scene: str
    start: dict
    duration: float
    end: int
    truth: Callable
    table: dict
    solref: tuple
    steps: tuple
    shift: tuple
    rigid: bool = True

    def vector(self, **changes) -> np.ndarray:
        """The inputs."""
        return np.array([*(SCENES[self.scene].inputs | self.start | changes).values()], float)

    def position(self, x: np.ndarray, solref: tuple | None) -> float:
        """The final position for inputs, in continuous time."""
        named = dict(zip(SCENES[self.scene].inputs, x, strict=True))
        return self.truth(named, solref, self.duration)

    def slope(self, x: np.ndarray, by: str, solref: tuple | None, h: float = 1e-5) -> float:
        """Its derivative by an input, by five-point differences."""
        way = h * self.direction(by)
        y = [self.position(x + k * way, solref) for k in (-2, -1, 1, 2)]
        return (y[0] - 8 * y[1] + 8 * y[2] - y[3]) / (12 * h)

    def direction(self, by: str) -> np.ndarray:
        """The unit vector of an input."""
        return np.array([float(name == by) for name in SCENES[self.scene].inputs])


def lossy(omega: float, e: float) -> tuple[float, float]:
    """`solref` of a spring that pushes only, of a frequency, with restitution e."""
    return -(omega**2), -2 * truths.damping_of(e) * omega


STIFF, FAST = (-2.5e5, 0.0), 2e-4
BILLIARD = {"x2": 1.0, "y2": 0.15, "v1": 2.0, "radius": 0.2}
MASSES = {"x2": 0.52, "v1": 1.0, "m1": 2.0, "e": 0.6}
TWICE = {"e": 0.8}
THROWN = {"vx": 3.0, "mu": 0.1, "e": 0.8}
SLOPE = math.radians(25)

CASES = [
    Case("G1", "slider", {"vz": -2.0, "e": 1.0, "g": 0.0}, 1.0, 1, truths.height,
         {"": 1.2, "z": -1, "vz": -1}, STIFF, (FAST,), ("z", 2.0)),
    Case("G2", "slider", TWICE, 0.8, 1, truths.height,
         {"": 0.671884927515, "z": 0.761713848619, "vz": 0.0289647136194, "e": 1.56171384862,
          "g": -0.0115858854478}, lossy(500, 0.8), (FAST,), ("z", 4.2)),
    Case("G2b", "slider", TWICE, 1.3, 1, truths.height,
         {"": 0.430773412982, "z": -0.254986992788, "vz": -0.0878635154851, "e": 0.514026014424,
          "g": 0.0571112850653}, lossy(500, 0.8), (FAST,), ("z", 4.2)),
    Case("G3", "slider", {}, 0.8, 1, truths.height, {"": 0.5861674599, "z": 0.7443554855},
         (0.02, 0.1), (1e-3, 5e-4), ("z", 4.2), rigid=False),
    Case("G3b", "slider", {}, 0.8, 1, truths.height, {"z": 0.645}, (0.1, 0.1),
         (4e-3, 2e-3, 1e-3), ("z", 4.2), rigid=False),
    Case("G4", "slider", {"z": RADIUS + 0.5, "vz": -1.0, "g": 0.0}, 2.0, 1, truths.height,
         # A wall that pushes only; one that pulls as it leaves has 0.84405, -0.80035, -1.24423.
         {"": 0.9526158815, "z": -0.8084243834, "vz": -1.2568280732}, (-50.0, -1.0),
         (4e-3, 2e-3, 1e-3), ("z", 1.0), rigid=False),
    Case("G7", "slider", {"z": RADIUS, "vx": 2.0, "mu": 0.5}, 0.8, 0, truths.stopped,
         {"": 0.407747196738, "vx": 0.407747196738, "mu": -0.815494393476, "m": 0},
         (0.02, 1.0), (1e-3,), ("vx", 4.9)),
    Case("G8", "slider", {"z": RADIUS, "mu": 0.2, "theta": SLOPE}, 0.5, 0, truths.down,
         {"": 0.295963658689, "theta": 1.21500705255, "mu": -1.11135992385},
         (0.02, 1.0), (1e-3,), ("x", 1.0)),
    Case("G10", "balls", {"x2": 0.52, "v1": 1.0}, 1.0, 2, truths.second_ball(0),
         {"": 1.2, "x1": 1, "x2": 0, "v1": 1, "v2": 0}, STIFF, (FAST,), ("x1", -1.0)),
    Case("G10b", "balls", MASSES, 1.0, 2, truths.second_ball(0),
         {"": 1.245333333, "x1": 1.066666667, "x2": -0.066666667, "v1": 1.066666667,
          "v2": -0.066666667, "m1": 0.120888889, "m2": -0.241777778, "e": 0.453333333},
         lossy(500, 0.6), (FAST,), ("x1", -1.0)),
    Case("G11x", "balls", BILLIARD, 1.0, 2, truths.second_ball(0),
         {"": 2.17803977874, "y2": -2.91790291225, "v1": 0.859375},
         (-2.5e6, 0.0), (1e-4,), ("x1", -2.0)),
    Case("G11y", "balls", BILLIARD, 1.0, 3, truths.second_ball(1),
         {"": 0.626540554083, "y2": 3.51644960458},
         (-2.5e6, 0.0), (1e-4,), ("x1", -2.0)),
    Case("G13", "slider", THROWN, 0.8, 0, truths.slid,
         {"": 2.11889150725, "vx": 0.8, "mu": -2.81108492752, "e": -0.156171384862,
          "z": 0.0238286151381}, lossy(500, 0.8), (FAST,), ("z", 4.2)),
]  # fmt: skip
