"""Adhesion: surfaces that stick, and actuators of bodies that pull them to what they touch."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather, take
from jaxsim.collision import Contact
from jaxsim.collision.parameters import contact_reach
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.rnea import generalized_force, wrench_on_links
from jaxsim.dynamics.transmission import BODY, Transmission, scalar_outputs
from jaxsim.forces.external import contact_wrench
from jaxsim.model import Model

_SPRING = mujoco.mjtDisableBit.mjDSBL_SPRING
_DAMPER = mujoco.mjtDisableBit.mjDSBL_DAMPER


def adhesive_bodies(model: Model) -> np.ndarray:
    """Actuators whose transmission is a body; static."""
    return np.flatnonzero(model.actuator_trntype == BODY)


def with_adhesion(model: Model, kin: Kinematics, t: Transmission, contact: Contact) -> Transmission:
    """The transmission with the moments of bodies: minus the mean of their contacts' normals.

    A contact counts from where MuJoCo lists it, closer than margin and gap together.

    Args:
      model: the model.
      kin: its kinematics.
      t: the transmission, with zero moments for bodies.
      contact: the contacts.
    """
    ids = adhesive_bodies(model)
    if not len(ids):
        return t
    _, other = scalar_outputs(model)
    bodies = jnp.asarray(model.actuator_trnid[ids, 0])
    rows = jax.vmap(lambda body: _moment(model, kin, contact, body))(bodies)
    outputs = model.actuator_outadr[ids]
    gear = take(model.actuator_gear[:, 0], outputs)
    return t.replace(rows=t.rows.at[np.searchsorted(other, outputs)].set(gear[:, None] * rows))


def _moment(model: Model, kin: Kinematics, contact: Contact, body) -> Float[Array, "nv"]:
    """Generalised force of a unit force of adhesion, shared by the contacts of a body."""
    pair = contact.geom1, contact.geom2, contact.pair
    bodies = (jnp.asarray(gather(model.geom_bodyid, geom)) for geom in pair[:2])
    counted = (contact.dist < contact_reach(model, *pair)) & sum(b == body for b in bodies).astype(
        bool
    )
    return _pull(model, kin, contact, counted / jnp.maximum(counted.sum(), 1))


def qfrc_adhesion(model: Model, kin: Kinematics, contact: Contact | None) -> Float[Array, "nv"]:
    """Generalised force of surfaces that pull each other along the normals of their contacts.

    It is a passive force: disabling both springs and dampers disables it, too.

    Args:
      model: the model.
      kin: its kinematics.
      contact: the contacts; None for none.
    """
    off = model.opt.disabled(_SPRING) and model.opt.disabled(_DAMPER)
    if off or contact is None or contact.adhesion is None:
        return jnp.zeros_like(model.dof_damping)
    return _pull(model, kin, contact, jnp.where(contact.active, contact.adhesion, 0.0))


def _pull(model: Model, kin: Kinematics, contact: Contact, size: Float[Array, "nc"]):
    """Generalised force of pulls of these sizes (N) at the contacts."""
    force = jnp.zeros((len(size), 6), contact.dist.dtype).at[:, 0].set(-size)
    wrench = contact_wrench(model, kin, contact, force)
    return generalized_force(model, kin, wrench_on_links(model, kin, wrench, kin.xipos))
