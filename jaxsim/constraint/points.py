"""Points where equality constraints join two bodies, and their motion."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather_or_zero, take
from jaxsim.dynamics.motion import Motion
from jaxsim.spatial import acceleration_at

_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


@struct.dataclass
class Ends:
    """Both ends of n equality constraints; every field has two entries, for first and second ends.

    Attributes:
      pos: points in world coordinates (m).
      omega: angular velocities of the bodies (rad/s).
      body: bodies, static.
      link: links that carry the bodies, -1 for none, static.
    """

    pos: tuple[Float[Array, "n 3"], Float[Array, "n 3"]]
    omega: tuple[Float[Array, "n 3"], Float[Array, "n 3"]]
    body: tuple = struct.field(pytree_node=False)
    link: tuple = struct.field(pytree_node=False)


def ends(motion: Motion, ids: np.ndarray, anchor1: Array, anchor2: Array) -> Ends:
    """The ends of equality constraints: anchors on bodies, or sites.

    Args:
      motion: position and velocity.
      ids: (n,) equality constraints.
      anchor1: (n, 3) anchors in the frames of the first bodies.
      anchor2: (n, 3) anchors in the frames of the second bodies.
    """
    model = motion.model
    sites = model.eq_objtype[ids] == _SITE
    pos, omega, body, link = [], [], [], []
    for objects, anchor in ((model.eq_obj1id[ids], anchor1), (model.eq_obj2id[ids], anchor2)):
        site = np.where(sites, objects, 0)
        b = np.where(sites, model.site_bodyid[site] if model.nsite else 0, objects)
        on_body = take(motion.kin.xpos, b) + jax.vmap(jnp.matmul)(take(motion.kin.xmat, b), anchor)
        if sites.any():
            on_body = jnp.where(sites[:, None], take(motion.kin.site_xpos, site), on_body)
        pos.append(on_body)
        body.append(b)
        link.append(model.body_link[b])
        omega.append(gather_or_zero(motion.vel.cvel, link[-1])[:, :3])
    return Ends(tuple(pos), tuple(omega), tuple(body), tuple(link))


def twist_rows(motion: Motion, e: Ends, side: int, rotation: bool) -> Float[Array, "n d 6"]:
    """Maps from the links' twists to the velocities of the points and, if `rotation`, to omega."""
    arm = e.pos[side] - gather_or_zero(motion.link_origins(), e.link[side])
    return jax.vmap(lambda r: point_map(r, rotation))(arm)


def point_map(arm: Float[Array, "3"], rotation: bool) -> Float[Array, "d 6"]:
    """`[[-arm x, 1]]`: from a twist about a reference point to the velocity at `arm` from it."""
    eye = jnp.eye(3, dtype=arm.dtype)
    # Row i of -[arm x] is arm x e_i.
    linear = jnp.concatenate([jnp.stack([jnp.cross(arm, eye[i]) for i in range(3)]), eye], axis=1)
    if not rotation:
        return linear
    return jnp.concatenate([linear, jnp.concatenate([eye, jnp.zeros_like(eye)], axis=1)])


def bias_acceleration(motion: Motion, e: Ends) -> Float[Array, "n 6"]:
    """`dJ/dt qvel` of the relative motion of both ends, linear part first."""
    total = 0.0
    for side, sign in ((0, 1.0), (1, -1.0)):
        arm = e.pos[side] - gather_or_zero(motion.link_origins(), e.link[side])
        a, v = (gather_or_zero(x, e.link[side]) for x in (motion.vel.bias, motion.vel.cvel))
        moved = jax.vmap(acceleration_at)(a, v, arm)
        total = total + sign * jnp.concatenate([moved[:, 3:], moved[:, :3]], axis=1)
    return total
