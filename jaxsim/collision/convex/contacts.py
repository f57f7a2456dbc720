"""`convex_pair`: pair functions of convex solids."""

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax

from jaxsim.collision.convex.faces import face_contacts
from jaxsim.collision.convex.manifold import Manifold, manifold
from jaxsim.collision.convex.search import search
from jaxsim.collision.convex.solid import Solid
from jaxsim.collision.convex.solid_pair import SolidPair
from jaxsim.collision.convex.touch import touch
from jaxsim.collision.frames import tangent_of
from jaxsim.collision.shapes import INACTIVE, Contacts, Shape


def _fixed(shape: Shape) -> Shape:
    """The shape without derivatives; those of the tables of hulls are zero."""
    pos, mat, size = lax.stop_gradient((shape.pos, shape.mat, shape.size))
    return shape.replace(pos=pos, mat=mat, size=size)


def convex_pair(
    first: type[Solid], second: type[Solid], max_contacts: int = 4
) -> tuple[Callable[[Shape, Shape], Contacts], int]:
    """The pair function of two kinds of solid, and its number of contact slots.

    With one contact, that is between the nearest points.
    """
    count = min(first.max_contacts, second.max_contacts, max_contacts)

    def pair(shape1: Shape, shape2: Shape) -> Contacts:
        solids = SolidPair(first(shape1), second(shape2))
        fixed = SolidPair(first(_fixed(shape1)), second(_fixed(shape2)))
        found = touch(solids, search(fixed))
        if count == 1:
            several = Manifold.of(found)
        elif first.clipped and second.clipped:
            several = face_contacts(solids, found)
        else:
            several = manifold(solids, found, count)
        radius1, radius2 = solids.first.radius, solids.second.radius
        normal = shape1.mat @ several.normal
        middle = several.middle + several.normal[None] * ((radius1 - radius2) / 2)
        pos = shape1.pos[None] + middle @ shape1.mat.T
        dist = several.dist - radius1 - radius2
        dist = jnp.where(several.exists, dist, INACTIVE)
        return Contacts(dist, pos, normal[None], tangent_of(normal)[None])

    return pair, count
