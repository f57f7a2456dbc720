"""Wrenches from outside on each body: applied by the user, by contacts and by equalities.

All are (torque, force) in world axes with the torque about the body's centre of mass `xipos`.
"""

from typing import Protocol

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float, Int

from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.tree import sum_by, take
from jaxsim.model import Model

_CONNECT = int(mujoco.mjtEq.mjEQ_CONNECT)
_WELD = int(mujoco.mjtEq.mjEQ_WELD)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


class ContactGeometry(Protocol):
    """Where contacts are: the part of `jaxsim.collision.Contact` that wrenches need."""

    pos: Float[Array, "nc 3"]
    frame: Float[Array, "nc 3 3"]
    geom1: Int[Array, "nc"] | np.ndarray
    geom2: Int[Array, "nc"] | np.ndarray


def external_wrench(
    model: Model,
    kin: Kinematics,
    xfrc_applied: Float[Array, "nbody 6"],
    contact: ContactGeometry | None = None,
    contact_force: Float[Array, "nc 6"] | None = None,
    eq_force: Float[Array, "neq 6"] | None = None,
) -> Float[Array, "nbody 6"]:
    """Sum of what acts on each body from outside its tree of joints.

    Args:
      model: the model.
      kin: its kinematics.
      xfrc_applied: (force, torque) applied by the user, in MuJoCo's order.
      contact: the contacts.
      contact_force: (force, torque) of each contact on geom2 in the contact's frame, as
        `mj_contactForce` returns it; zero for a contact without force.
      eq_force: multipliers of connect and weld equalities in the order of MuJoCo's rows, (force,
        torque); a connect has no torque, and all other or inactive equalities are zero.
    """
    total = jnp.concatenate([xfrc_applied[:, 3:], xfrc_applied[:, :3]], axis=1)
    if contact is not None and contact_force is not None:
        total = total + contact_wrench(model, kin, contact, contact_force)
    if eq_force is not None:
        total = total + equality_wrench(model, kin, eq_force)
    return total


def contact_wrench(
    model: Model, kin: Kinematics, contact: ContactGeometry, force: Float[Array, "nc 6"]
) -> Float[Array, "nbody 6"]:
    """Wrenches of contacts on bodies: `+F` on the body of geom2, `-F` on that of geom1.

    Args:
      model: the model.
      kin: its kinematics.
      contact: the contacts.
      force: (force, torque) in the contact's frame, as in `external_wrench`.
    """
    if not len(contact.pos):
        return jnp.zeros((model.nbody, 6), kin.xipos.dtype)

    def world(R, local):
        return R.T @ local[3:], R.T @ local[:3]

    torque, force = jax.vmap(world)(contact.frame, force)
    body1, body2 = (geom_body(model, geom) for geom in (contact.geom1, contact.geom2))
    first = _at_bodies(model, kin, body1, contact.pos, -torque, -force)
    return first + _at_bodies(model, kin, body2, contact.pos, torque, force)


def equality_wrench(
    model: Model, kin: Kinematics, force: Float[Array, "neq 6"]
) -> Float[Array, "nbody 6"]:
    """Wrenches of connect and weld equalities: `+F` at obj1's anchor, `-F` at obj2's.

    As in MuJoCo, a weld's rotational multipliers stand for its torque.

    Args:
      model: the model.
      kin: its kinematics.
      force: (force, torque) multipliers as in `external_wrench`.
    """
    (rows,) = np.nonzero(np.isin(model.eq_type, (_CONNECT, _WELD)))
    if not len(rows):
        return jnp.zeros((model.nbody, 6), kin.xipos.dtype)
    force = take(force, rows)
    is_weld = jnp.asarray(model.eq_type[rows] == _WELD)[:, None]
    torque, force = jnp.where(is_weld, force[:, 3:], 0), force[:, :3]
    # A weld's data has the anchor on the second body first, a connect's that on the first.
    ahead, behind = (take(model.eq_data, rows)[:, s] for s in (slice(0, 3), slice(3, 6)))
    body1, pos1 = _anchor(model, kin, rows, model.eq_obj1id, jnp.where(is_weld, behind, ahead))
    body2, pos2 = _anchor(model, kin, rows, model.eq_obj2id, jnp.where(is_weld, ahead, behind))
    first = _at_bodies(model, kin, body1, pos1, torque, force)
    return first + _at_bodies(model, kin, body2, pos2, -torque, -force)


def geom_body(model: Model, geom: Int[Array, "n"] | np.ndarray) -> Int[Array, "n"] | np.ndarray:
    """Bodies of geoms; static if the geoms are."""
    if isinstance(geom, np.ndarray):
        return model.geom_bodyid[geom]
    return jnp.asarray(model.geom_bodyid, geom.dtype)[geom]


def _anchor(model: Model, kin: Kinematics, rows, objects, local):
    """Body and world position of one end of some equalities."""
    objects = objects[rows]
    at_site = model.eq_objtype[rows] == _SITE
    body = objects.copy()
    body[at_site] = model.site_bodyid[objects[at_site]]
    if at_site.any():
        site = take(model.site_pos, np.where(at_site, objects, 0))
        local = jnp.where(jnp.asarray(at_site)[:, None], site, local)
    pos = jax.vmap(lambda p, R, x: p + R @ x)(take(kin.xpos, body), take(kin.xmat, body), local)
    return body, pos


def _at_bodies(model: Model, kin: Kinematics, body, pos, torque, force):
    """Sums over bodies of wrenches at world points, moved to the bodies' centres of mass."""
    static = isinstance(body, np.ndarray)
    com = take(kin.xipos, body) if static else kin.xipos[body]
    wrench = jnp.concatenate([torque + jnp.cross(pos - com, force), force], axis=1)
    if static:
        return sum_by(wrench, body, model.nbody)
    return jnp.zeros((model.nbody, 6), wrench.dtype).at[body].add(wrench)
