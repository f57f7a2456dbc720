"""Surfaces that move while their geom stays, such as conveyor belts."""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather
from jaxsim.collision import Contact
from jaxsim.dynamics.motion import Motion


def surface_velocity(motion: Motion, contact: Contact) -> Float[Array, "n 6"]:
    """Velocity of geom2's surface relative to geom1's, in the contacts' frames, about their points.

    As in MuJoCo, only sliding and spinning count: surfaces neither push nor roll.

    Args:
      motion: position and velocity.
      contact: the contacts.
    """
    kin, leaf = motion.kin, motion.model.geom_surfacevel

    def one(pos, frame, surface, xpos, xmat):
        angular = xmat @ surface[3:]
        linear = xmat @ surface[:3] + jnp.cross(angular, pos - xpos)
        return jnp.concatenate([frame @ linear, frame @ angular])

    first, second = (
        jax.vmap(one)(
            contact.pos,
            contact.frame,
            *(gather(x, geom) for x in (leaf, kin.geom_xpos, kin.geom_xmat)),
        )
        for geom in (contact.geom1, contact.geom2)
    )
    counted = jnp.asarray(np.array([[0, 1, 1, 1, 0, 0]]), first.dtype)
    return counted * (second - first)
