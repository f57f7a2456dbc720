"""Contact rows: frictionless, pyramidal and elliptic.

In the contact frame a relative motion has a normal, two sliding, one spinning and two rolling
components; `condim` says how many of them are constrained, and each of these is a row.
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.collision import Contact, ContactKind
from jaxsim.constraint.block import Block, inverse_where
from jaxsim.constraint.contact_rows import contact_rows
from jaxsim.constraint.impedance import MIN_VALUE, response
from jaxsim.constraint.scene import Scene
from jaxsim.solver import EllipticCone, PyramidalCone, Unilateral

ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)


def contact_blocks(scene: Scene, contact: Contact) -> list[Block]:
    """One block of rows for each kind of contact."""
    return [
        _block(scene, _slots(contact, b.slots), b.kind) for b in contact.blocks if b.stop > b.start
    ]


def contact_forces(contact: Contact, forces: list[Array]) -> Float[Array, "nc 6"]:
    """(force, torque) of each contact in its frame, on geom2 from geom1: `mj_contactForce`.

    Args:
      contact: the contacts.
      forces: row forces of the contact blocks, in the order of `contact_blocks`.
    """
    parts = [jnp.zeros((0, 6), contact.dist.dtype)]
    blocks = [b for b in contact.blocks if b.stop > b.start]
    for b, rows in zip(blocks, forces, strict=True):
        parts.append(jnp.pad(rows, ((0, 0), (0, 6 - b.condim))))
    return jnp.concatenate(parts)


def _slots(contact: Contact, slots: slice):
    """The contacts of one block; ids may be numpy arrays, which `jax.tree.map` would trace."""
    fields = (
        "dist pos frame includemargin friction solref solreffriction solimp geom1 geom2".split()
    )
    return contact.replace(**{name: getattr(contact, name)[slots] for name in fields})


def _block(scene: Scene, contact: Contact, kind: ContactKind) -> Block:
    model, condim = scene.model, kind.condim
    bodies = [_lookup(model.geom_bodyid, g) for g in (contact.geom1, contact.geom2)]
    links = [
        _lookup(model.body_link, body) if movable else np.full(len(contact.dist), -1)
        for body, movable in zip(bodies, kind.movable, strict=True)
    ]
    first, second = (_values(model.body_invweight0, b) for b in bodies)
    weight = first + second
    violation = contact.dist - contact.includemargin
    arms = [_arms(scene, contact.pos, link) for link in links]
    jacobian = contact_rows(contact.frame, condim, arms, links)
    velocity = scene.velocity(jacobian)
    pyramidal = condim > 1 and model.opt.cone != ELLIPTIC
    cone = _pyramidal_cone if pyramidal else _elliptic_cone
    make = jax.vmap(lambda *a: cone(model.opt, condim, *a))
    rows = make(
        violation,
        velocity,
        weight[:, 0],
        contact.friction,
        contact.solref,
        contact.solreffriction,
        contact.solimp,
    )
    if condim == 1:
        rows = Unilateral(aref=rows.aref, D=rows.D)
    return Block(rows, jacobian, violation, velocity, f"contact{condim}")


def _lookup(table: np.ndarray, index):
    """Static where the index is."""
    return np.asarray(table)[index] if isinstance(index, np.ndarray) else jnp.asarray(table)[index]


def _values(values: Array, index) -> Array:
    return take(values, index) if isinstance(index, np.ndarray) else values[index]


def _arms(scene: Scene, pos: Float[Array, "n 3"], link) -> Float[Array, "n 3"]:
    """Points from the reference points of links; anything where the link is -1."""
    origins = scene.link_origins()
    return pos - _values(origins, link % max(len(origins), 1))


def _pyramidal_cone(
    opt, condim, violation, velocity, weight, friction, solref, _, solimp
) -> PyramidalCone:
    """All edges share one regularisation, that of the elliptic cone's friction."""
    r = response(opt, solref, solimp, violation)
    active = violation < 0
    mu = friction[0] / jnp.sqrt(jnp.maximum(opt.impratio, MIN_VALUE))
    R = 2 * mu * mu * r.regularisation(weight * (1 + friction[0] * friction[0]))
    aref = jnp.concatenate([r.reference(velocity[:1], violation), r.reference(velocity[1:], 0.0)])
    aref = jnp.where(active, aref, 0.0)
    return PyramidalCone(aref=aref, D=inverse_where(active, R), mu=friction[: condim - 1])


def _elliptic_cone(
    opt, condim, violation, velocity, weight, friction, solref, solreffriction, solimp
) -> EllipticCone:
    """Normal and friction rows; friction only damps, with its own reference if it has one."""
    normal = response(opt, solref, solimp, violation)
    own = (solreffriction != 0).any() & ((solreffriction[0] > 0) == (solreffriction[1] > 0))
    tangent = response(opt, jnp.where(own, solreffriction, solref), solimp, violation)
    active = violation < 0
    aref = jnp.concatenate(
        [normal.reference(velocity[:1], violation), tangent.reference(velocity[1:], 0.0)]
    )
    friction = friction[: condim - 1]
    R0 = normal.regularisation(weight)
    R1 = R0 / jnp.maximum(opt.impratio, MIN_VALUE)
    # friction[j]^2 R[j] is the same in all directions.
    tangents = R1 * (friction[:1] / friction) ** 2
    R = jnp.concatenate([R0[None], tangents])
    mu = friction[0] * jnp.sqrt(R1 / R0) if condim > 1 else jnp.zeros_like(R0)
    return EllipticCone(
        aref=jnp.where(active, aref, 0.0), D=inverse_where(active, R), mu=mu, friction=friction
    )
