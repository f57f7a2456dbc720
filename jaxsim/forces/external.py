"""External wrenches on each body: applied by the user, by contacts and by equalities.

They are (torque, force) in world axes, with the torque about the body's centre of mass `xipos`.
"""

from typing import Protocol

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import gather, sum_by, take
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.model import Model
from jaxsim.spatial import quat_conj, quat_mul, wrench_from

_CONNECT = int(mujoco.mjtEq.mjEQ_CONNECT)
_WELD = int(mujoco.mjtEq.mjEQ_WELD)
_SITE = int(mujoco.mjtObj.mjOBJ_SITE)


class ContactGeometry(Protocol):
    """The fields of `jaxsim.collision.Contact` that are read here and by sensors."""

    dist: Float[Array, "nc"]
    includemargin: Float[Array, "nc"]
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
    """Sum of the external wrenches on each body.

    Args:
      model: the model.
      kin: its kinematics.
      xfrc_applied: (force, torque) applied by the user, in this order as in MuJoCo.
      contact: the contacts.
      contact_force: (force, torque) of each contact on geom2 in the contact's frame, as
        `mj_contactForce` returns it; zero for a contact without force.
      eq_force: multipliers of connect and weld equalities, three of translation, then three of
        rotation, in the order of MuJoCo's rows. Zero where there is none: for the rotation of a
        connect, and for other equalities.

    Returns:
      (torque, force) on each body.
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
        return jnp.concatenate([R.T @ local[3:], R.T @ local[:3]])

    wrench = jax.vmap(world)(contact.frame, force)
    body1, body2 = (gather(model.geom_bodyid, geom) for geom in (contact.geom1, contact.geom2))
    first = _at_bodies(model, kin, body1, contact.pos, -wrench)
    return first + _at_bodies(model, kin, body2, contact.pos, wrench)


def equality_wrench(
    model: Model, kin: Kinematics, force: Float[Array, "neq 6"]
) -> Float[Array, "nbody 6"]:
    """Wrenches of connect and weld equalities: `+F` on the first body, `-F` on the second.

    The residual of a weld's rotational rows is `s Im(q2* q1)`, with the orientations q1 (of the
    first body times the relative pose) and q2 of both sides, and the scale s. So multipliers f of
    these rows give the torque `s Im(q2 f q1*) / 2`.

    Args:
      model: the model.
      kin: its kinematics.
      force: multipliers as in `external_wrench`.
    """
    (rows,) = np.nonzero(np.isin(model.eq_type, (_CONNECT, _WELD)))
    if not len(rows):
        return jnp.zeros((model.nbody, 6), kin.xipos.dtype)
    data, force = take(model.eq_data, rows), take(force, rows)
    is_weld = jnp.asarray(model.eq_type[rows] == _WELD)[:, None]
    # In `eq_data`, the first anchor of a weld is on the second body, that of a connect on the
    # first.
    anchor1 = jnp.where(is_weld, data[:, 3:6], data[:, :3])
    anchor2 = jnp.where(is_weld, data[:, :3], data[:, 3:6])
    body1, pos1, quat1 = _end(model, kin, rows, model.eq_obj1id, anchor1)
    body2, pos2, quat2 = _end(model, kin, rows, model.eq_obj2id, anchor2)
    at_site = jnp.asarray(model.eq_objtype[rows] == _SITE)[:, None]
    quat1 = jnp.where(at_site, quat1, jax.vmap(quat_mul)(quat1, data[:, 6:10]))
    torque = data[:, 10:11] * jax.vmap(_weld_torque)(quat1, quat2, force[:, 3:])
    wrench = jnp.concatenate([jnp.where(is_weld, torque, 0), force[:, :3]], axis=1)
    first = _at_bodies(model, kin, body1, pos1, wrench)
    return first + _at_bodies(model, kin, body2, pos2, -wrench)


def _end(model: Model, kin: Kinematics, rows, objects, anchor):
    """Body, world position and orientation of one end of some equalities."""
    objects = objects[rows]
    at_site = model.eq_objtype[rows] == _SITE
    body = objects.copy()
    body[at_site] = model.site_bodyid[objects[at_site]]
    quat = take(kin.xquat, body)
    if at_site.any():
        site, choose = np.where(at_site, objects, 0), jnp.asarray(at_site)[:, None]
        anchor = jnp.where(choose, take(model.site_pos, site), anchor)
        turned = jax.vmap(quat_mul)(quat, take(model.site_quat, site))
        quat = jnp.where(choose, turned, quat)
    pos = jax.vmap(lambda p, R, x: p + R @ x)(take(kin.xpos, body), take(kin.xmat, body), anchor)
    return body, pos, quat


def _weld_torque(quat1, quat2, f):
    """`Im(q2 f q1*) / 2`."""
    pure = jnp.concatenate([jnp.zeros_like(f[:1]), f])
    return 0.5 * quat_mul(quat_mul(quat2, pure), quat_conj(quat1))[1:]


def _at_bodies(model: Model, kin: Kinematics, body, pos, wrench):
    """(nbody, 6) sums of wrenches at points `pos` on bodies, about the bodies' centres of mass."""
    moved = jax.vmap(wrench_from)(wrench, pos - gather(kin.xipos, body))
    return sum_by(moved, body, model.nbody)
