"""The table of pair functions, by the types of both shapes.

To support another pair, write a function `(first, second) -> Contacts` under `pairs/` and add a
line here. The shape with the lower type number (`mujoco.mjtGeom`) comes first, as in MuJoCo.
"""

import dataclasses
from collections.abc import Callable

import mujoco

from jaxsim.collision.convex import (
    Box,
    Cylinder,
    Ellipsoid,
    Point,
    Polytope,
    Segment,
    Solid,
    convex_pair,
)
from jaxsim.collision.pairs.box import capsule_box, sphere_box
from jaxsim.collision.pairs.box_box import box_box
from jaxsim.collision.pairs.capsule import capsule_capsule, sphere_capsule, sphere_sphere
from jaxsim.collision.pairs.cylinder import sphere_cylinder
from jaxsim.collision.pairs.height_field import (
    MAX_CONTACTS,
    height_field_pair,
    height_field_sphere,
)
from jaxsim.collision.pairs.plane import (
    plane_box,
    plane_capsule,
    plane_cylinder,
    plane_ellipsoid,
    plane_mesh,
    plane_sphere,
)
from jaxsim.collision.sdf import body, sdf_pair
from jaxsim.collision.shapes import Contacts, Shape
from jaxsim.model.enums import constant_name

PLANE = int(mujoco.mjtGeom.mjGEOM_PLANE)
HFIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)
SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
ELLIPSOID = int(mujoco.mjtGeom.mjGEOM_ELLIPSOID)
CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)
BOX = int(mujoco.mjtGeom.mjGEOM_BOX)
MESH = int(mujoco.mjtGeom.mjGEOM_MESH)
SDF = int(mujoco.mjtGeom.mjGEOM_SDF)


@dataclasses.dataclass(frozen=True)
class PairFunction:
    """A function of two shapes and the number of contact slots that it fills.

    Attributes:
      function: the function.
      max_contacts: number of slots.
      large: whether its program is so large that it should be in a program once.
      to_margin: whether it reads the margin of the first shape.
    """

    function: Callable[[Shape, Shape], Contacts]
    max_contacts: int
    large: bool = False
    to_margin: bool = False


def _convex(first: type[Solid], second: type[Solid]) -> PairFunction:
    function, count = convex_pair(first, second)
    return PairFunction(function, count, large=True, to_margin=count > 1)


PAIRS: dict[tuple[int, int], PairFunction] = {
    (PLANE, SPHERE): PairFunction(plane_sphere, 1),
    (PLANE, CAPSULE): PairFunction(plane_capsule, 2),
    (PLANE, ELLIPSOID): PairFunction(plane_ellipsoid, 1),
    (PLANE, CYLINDER): PairFunction(plane_cylinder, 4),
    (PLANE, BOX): PairFunction(plane_box, 4),
    (PLANE, MESH): PairFunction(plane_mesh, 4, large=True),
    (HFIELD, SPHERE): PairFunction(height_field_sphere, MAX_CONTACTS),
    (HFIELD, CAPSULE): PairFunction(*height_field_pair(Segment)),
    (HFIELD, ELLIPSOID): PairFunction(*height_field_pair(Ellipsoid)),
    (HFIELD, CYLINDER): PairFunction(*height_field_pair(Cylinder)),
    (HFIELD, BOX): PairFunction(*height_field_pair(Box)),
    (HFIELD, MESH): PairFunction(*height_field_pair(Polytope)),
    (SPHERE, SPHERE): PairFunction(sphere_sphere, 1),
    (SPHERE, CAPSULE): PairFunction(sphere_capsule, 1),
    (SPHERE, CYLINDER): PairFunction(sphere_cylinder, 1),
    (SPHERE, BOX): PairFunction(sphere_box, 1),
    (CAPSULE, CAPSULE): PairFunction(capsule_capsule, 2),
    (CAPSULE, BOX): PairFunction(capsule_box, 2),
    (BOX, BOX): PairFunction(box_box, 8, large=True),
    (SPHERE, ELLIPSOID): _convex(Point, Ellipsoid),
    (SPHERE, MESH): _convex(Point, Polytope),
    (CAPSULE, ELLIPSOID): _convex(Segment, Ellipsoid),
    (CAPSULE, CYLINDER): _convex(Segment, Cylinder),
    (CAPSULE, MESH): _convex(Segment, Polytope),
    (ELLIPSOID, ELLIPSOID): _convex(Ellipsoid, Ellipsoid),
    (ELLIPSOID, CYLINDER): _convex(Ellipsoid, Cylinder),
    (ELLIPSOID, BOX): _convex(Ellipsoid, Box),
    (ELLIPSOID, MESH): _convex(Ellipsoid, Polytope),
    (CYLINDER, CYLINDER): _convex(Cylinder, Cylinder),
    (CYLINDER, BOX): _convex(Cylinder, Box),
    (CYLINDER, MESH): _convex(Cylinder, Polytope),
    (BOX, MESH): _convex(Box, Polytope),
    (MESH, MESH): _convex(Polytope, Polytope),
    (PLANE, SDF): PairFunction(*sdf_pair(body.plane)),
    (SPHERE, SDF): PairFunction(*sdf_pair(body.sphere)),
    (CAPSULE, SDF): PairFunction(*sdf_pair(body.capsule)),
    (ELLIPSOID, SDF): PairFunction(*sdf_pair(body.ellipsoid)),
    (CYLINDER, SDF): PairFunction(*sdf_pair(body.cylinder)),
    (BOX, SDF): PairFunction(*sdf_pair(body.box)),
    (MESH, SDF): PairFunction(*sdf_pair(body.mesh)),
    (SDF, SDF): PairFunction(*sdf_pair(body.signed_distance)),
}


def type_name(geom_type: int) -> str:
    """MJCF's name of a geom type: `type_name(3) == "capsule"`."""
    return constant_name("mjtGeom", geom_type).lower()


def supported_pairs() -> str:
    """The pairs of the table as text for messages."""
    return ", ".join(f"{type_name(a)}-{type_name(b)}" for a, b in PAIRS)
