"""Contacts of two convex solids: signed distance, normal and contact points.

`solid` defines the interface of a solid. `search` finds the features of two solids that touch.
`touch` solves for normal and points with these features held fixed, which makes them
differentiable. `manifold` finds several contacts where faces lie on each other.
"""

from jaxsim.collision.convex.contacts import convex_pair
from jaxsim.collision.convex.cylinder import Cylinder
from jaxsim.collision.convex.polytope import Box, Polytope
from jaxsim.collision.convex.round import Ellipsoid, Point, Segment
from jaxsim.collision.convex.solid import Solid

__all__ = [
    "Box",
    "Cylinder",
    "Ellipsoid",
    "Point",
    "Polytope",
    "Segment",
    "Solid",
    "convex_pair",
]
