"""Convex solids: signed distance, normal and contact points of any two of them.

`solid` says what a solid is, `search` finds where two of them touch, `touch` computes it again with
the features that touch held fixed, so that it has derivatives, and `manifold` gives faces that lie
on each other several contacts.
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
