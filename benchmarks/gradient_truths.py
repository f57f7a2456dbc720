"""Closed forms of motions through contact: rigid ones, and ones on damped springs.

A rigid motion is followed from impact to impact. With soft contact of constant impedance d the
normal motion is that of a damped spring,

    r'' = -k r - b r' - (1 - d) g    while r < 0 and it pushes,

so that it, too, is known between the times of impact. The difference of the two is the error that a
spring makes where rigid contact is meant. Lengths are in m, times in s.
"""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

RADIUS, IMPEDANCE, G = 0.1, 0.95, 9.81


class Motion(NamedTuple):
    """Height and vertical speed at the end, after so many bounces."""

    z: float
    v: float
    bounces: int


def rigid_bounces(z: float, v: float, g: float, e: float, duration: float) -> Motion:
    """A fall onto a plane with Newton's restitution."""
    bounces, left = 0, duration
    while (t := _fall(z, v, g)) < left:
        z, v, left, bounces = 0.0, e * (g * t - v), left - t, bounces + 1
    return Motion(z + v * left - g * left**2 / 2, v - g * left, bounces)


def soft_bounces(z: float, v: float, g: float, solref: tuple, duration: float) -> Motion:
    """The same on a damped spring that pushes only; it leaves where its force ends."""
    k, b = spring(solref)
    weight, bounces, left = (1 - IMPEDANCE) * g, 0, duration
    while (t := _fall(z, v, g)) < left:
        v, left, bounces = v - g * t, left - t, bounces + 1
        decay, omega, rest = b / 2, math.sqrt(k - b * b / 4), -weight / k

        def at(t, v=v, decay=decay, omega=omega, rest=rest):
            c, s = -rest, (v - decay * rest) / omega
            swing = math.exp(-decay * t)
            cos, sin = math.cos(omega * t), math.sin(omega * t)
            r = swing * (c * cos + s * sin)
            rate = swing * (omega * (s * cos - c * sin)) - decay * r
            return rest + r, rate

        force = lambda t: -k * at(t)[0] - b * at(t)[1] + IMPEDANCE * g  # noqa: E731
        low, high = 0.3 * math.pi / omega, 1.5 * math.pi / omega
        for _ in range(80):
            middle = (low + high) / 2
            low, high = (middle, high) if force(middle) > 0 else (low, middle)
        end = min(low, left)
        (z, v), left = at(end), left - end
        if left <= 0:
            break
    return Motion(z + v * left - g * left**2 / 2, v - g * left, bounces)


def spring(solref: tuple) -> tuple[float, float]:
    """Stiffness and damping of `solref` in either format, for a unit mass."""
    if solref[0] < 0:
        return -solref[0], -solref[1]
    tau, zeta = solref
    return 1 / (tau * zeta) ** 2, 2 / tau


def delay(solref: tuple) -> float:
    """By how much later than a rigid one a spring sends back, without gravity."""
    k, b = spring(solref)
    omega, zeta = math.sqrt(k), b / (2 * math.sqrt(k))
    q = math.sqrt(1 - zeta**2)
    return (math.pi - math.atan2(2 * zeta * q, 1 - 2 * zeta**2)) / (q * omega) + 2 * zeta / omega


def _fall(z: float, v: float, g: float) -> float:
    """Time until a height of zero is reached from above; infinite if it is not."""
    if g == 0:
        return -z / v if v < 0 < z else math.inf
    square = v * v + 2 * g * z
    if square < 0 or (z <= 0 and v <= 0):
        return math.inf
    return (v + math.sqrt(square)) / g


def damping_of(restitution: float) -> float:
    """The damping ratio of a spring that pushes only and loses so much."""
    low, high = 0.0, 0.9
    for _ in range(60):
        zeta = (low + high) / 2
        q = math.sqrt(1 - zeta**2)
        e = math.exp(-zeta / q * (math.pi - math.atan2(2 * zeta * q, 1 - 2 * zeta**2)))
        low, high = (zeta, high) if e > restitution else (low, zeta)
    return zeta


def height(p: dict, solref, duration: float) -> float:
    """Final height of a bouncing mass; rigid without `solref`."""
    start = p["z"] - RADIUS, p["vz"], p["g"]
    if solref is None:
        return RADIUS + rigid_bounces(*start, p["e"], duration).z
    return RADIUS + soft_bounces(*start, solref, duration).z


def slid(p: dict, solref, duration: float) -> float:
    """Final x of a mass that bounces with Coulomb's friction and never sticks."""
    free = p["z"] + p["vz"] * duration - p["g"] * duration**2 / 2
    return p["x"] + p["vx"] * duration - p["mu"] * (height(p, solref, duration) - free)


def stopped(p: dict, solref, duration: float) -> float:
    """Final x of a block on the plane, from a speed to rest.

    Soft friction is viscous below the speed `mu g tau / 2`, which adds `mu g tau^2 / 8`.
    """
    creep = 0 if solref is None else p["mu"] * p["g"] * solref[0] ** 2 / 8
    return p["x"] + p["vx"] ** 2 / (2 * p["mu"] * p["g"]) + creep


def down(p: dict, solref, duration: float) -> float:
    """Final x of a block that slides down a slope from rest.

    Soft friction begins as viscous: `v' = g sin - 2 v / tau` until it has Coulomb's size.
    """
    along, across = p["g"] * math.sin(p["theta"]), p["g"] * math.cos(p["theta"])
    a, t, v, x = along - p["mu"] * across, 0.0, 0.0, p["x"]
    if solref is not None:
        rate = 2 / solref[0]
        v = p["mu"] * across / rate
        t = -math.log(1 - rate * v / along) / rate
        x += (along * t - v) / rate
    left = duration - t
    return x + v * left + a * left**2 / 2


def second_ball(axis: int) -> Callable:
    """Final position of the second of two balls that meet once; rigid, friction-free."""

    def position(p: dict, solref, duration: float) -> float:
        d = np.array([p["x2"] - p["x1"], p["y2"] - p["y1"]])
        w = np.array([p["v2"] - p["v1"], p["u2"] - p["u1"]])
        second = np.array([p["x2"], p["y2"]]), np.array([p["v2"], p["u2"]])
        half, square = d @ w, w @ w
        root = half**2 - square * (d @ d - 4 * p["radius"] ** 2)
        if root < 0 or half > 0:
            return (second[0] + duration * second[1])[axis]
        t = (-half - math.sqrt(root)) / square
        normal = (d + t * w) / (2 * p["radius"])
        approach, share = -(w @ normal), p["m1"] / (p["m1"] + p["m2"])
        # On a spring their distance along the normal is that of rigid balls, but later.
        late = 0.0 if solref is None else delay(solref)
        change = share * ((1 + p["e"]) * (duration - t) - p["e"] * late) * approach * normal
        return (second[0] + duration * second[1] + change)[axis]

    return position
