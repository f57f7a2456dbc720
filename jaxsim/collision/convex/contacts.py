"""`convex_pair`: pair functions of convex solids."""

from collections.abc import Callable

import jax.numpy as jnp
from jax import lax

from jaxsim.collision.convex.faces import face_contacts
from jaxsim.collision.convex.manifold import Manifold
from jaxsim.collision.convex.search import search
from jaxsim.collision.convex.solid import Solid
from jaxsim.collision.convex.solid_pair import SolidPair
from jaxsim.collision.convex.touch import Touch, touch
from jaxsim.collision.frames import tangent_of
from jaxsim.collision.shapes import INACTIVE, Contacts, Shape


def _fixed(shape: Shape) -> Shape:
    """The shape without derivatives; those of the tables of hulls are zero."""
    pos, mat, size = lax.stop_gradient((shape.pos, shape.mat, shape.size))
    return shape.replace(pos=pos, mat=mat, size=size)


def _of_surfaces(solids: SolidPair, cores: Touch) -> Touch:
    """The contact of the surfaces around the cores."""
    radius1, radius2 = solids.first.radius, solids.second.radius
    return cores.replace(
        dist=cores.dist - radius1 - radius2,
        first=cores.first + cores.normal * radius1,
        second=cores.second - cores.normal * radius2,
    )


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
        found = _of_surfaces(solids, touch(solids, search(fixed)))
        # A pair with two slots has a capsule: its edge has two ends.
        several = Manifold.of(found) if count == 1 else face_contacts(solids, found).in_slots(count)
        normal = shape1.mat @ several.normal
        pos = shape1.pos[None] + several.middle @ shape1.mat.T
        dist = jnp.where(several.exists, several.dist, INACTIVE)
        return Contacts(dist, pos, normal[None], tangent_of(normal)[None])

    return pair, count
