"""Blocks of contact rows, with the cost that the model's contact law gives them."""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import Index, gather
from jaxsim.collision import Contact, ContactKind
from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.contact_rows import ContactRows, contact_rows
from jaxsim.constraint.conveyor import surface_velocity
from jaxsim.constraint.entry import Entry, entry
from jaxsim.constraint.impedance import response
from jaxsim.constraint.jacobian import row_velocity
from jaxsim.constraint.laws import (
    LAWS,
    RIGID,
    Blur,
    ContactState,
    Material,
    blurred,
    contact_material,
)
from jaxsim.constraint.laws.mujoco import ELLIPTIC
from jaxsim.constraint.rigid.impact import Approach
from jaxsim.constraint.row_inertia import contact_inertia
from jaxsim.dynamics.motion import Motion
from jaxsim.model import Model, ModelError, Option

# Bound on the rounding error of a distance, in units of rounding of positions in metres.
_UNITS = 4


def contact_blocks(motion: Motion, contact: Contact, blur: Blur | None = None) -> list[Block]:
    """One block of rows for each kind of contact, in the order of the slots.

    Args:
      motion: position and velocity.
      contact: the contacts there.
      blur: how much the law of contact is smoothed; None for the law itself.
    """
    sharp = LAWS[motion.model.contact]
    if blur is not None and contact.adhesion is not None:
        raise ModelError("smoothed contacts do not combine with adhesion of geoms or pairs")
    law = sharp if blur is None else blurred(sharp, blur)
    ranges = [r for r in contact.ranges if r.stop > r.start]
    return [_block(motion, _slots(contact, r.slots), r.kind, law) for r in ranges]


def contact_forces(
    contact: Contact, blocks: list[Block], forces: tuple[Array, ...]
) -> Float[Array, "nc 6"]:
    """(force, torque) on geom2 of each contact, in the contact frame, as `mj_contactForce`.

    Adhesion pulls it towards geom1.

    Args:
      contact: the contacts.
      blocks: all constraint rows.
      forces: forces of the rows of each block.
    """
    pairs = zip(blocks, forces, strict=True)
    rows = [force for block, force in pairs if block.type is RowType.CONTACT]
    if not rows:
        return jnp.zeros((contact.dist.shape[0], 6), contact.dist.dtype)
    total = jnp.concatenate([jnp.pad(f, ((0, 0), (0, 6 - f.shape[1]))) for f in rows])
    if contact.adhesion is None:
        return total
    return total.at[:, 0].add(-jnp.where(contact.active, contact.adhesion, 0.0))


def _slots(contact: Contact, slots: slice) -> Contact:
    """The contacts of one range; not by `jax.tree.map`, which would trace ids in NumPy arrays."""
    fields = (
        "dist pos frame includemargin friction solref solreffriction solimp geom1 geom2".split()
    )
    if contact.adhesion is not None:
        fields += ["adhesion", "gap"]
    return contact.replace(**{name: getattr(contact, name)[slots] for name in fields})


def _block(
    motion: Motion,
    contact: Contact,
    kind: ContactKind,
    law: Callable[[Option, ContactState], Any],
) -> Block:
    model = motion.model
    bodies = [gather(model.geom_bodyid, geom) for geom in (contact.geom1, contact.geom2)]
    jacobian = _jacobian(motion, contact, kind, bodies)
    first, second = (gather(model.body_invweight0, body) for body in bodies)
    velocity = row_velocity(motion, jacobian)
    if model.nonzero_rows("geom_surfacevel"):
        velocity = velocity + surface_velocity(motion, contact)[:, : kind.condim]
    dist = contact.dist
    if motion.ahead is not None:  # at the beginning of the step
        dist = dist - motion.ahead * velocity[:, 0]
    friction = None
    if model.contact == "mujoco" and kind.condim > 1 and model.opt.cone != ELLIPTIC:
        friction = _sliding(contact)
    state = ContactState(
        dist=dist,
        includemargin=contact.includemargin,
        rounding=_rounding(contact.pos),
        velocity=velocity,
        inverse_weight=contact_inertia(motion, jacobian, (first + second)[:, 0], friction),
        friction=contact.friction,
        solref=contact.solref,
        solreffriction=contact.solreffriction,
        solimp=contact.solimp,
        adhesion=contact.adhesion,
        gap=contact.gap,
        material=None if model.contact == "mujoco" else _material(model, contact),
    )
    cost = jax.vmap(lambda c: law(model.opt, c))
    block = Block(cost(state), jacobian, RowType.CONTACT, weight=state.inverse_weight)
    if model.contact in RIGID:
        return block.replace(approach=_approach(state))
    if not model.backward.entry_time:
        return block
    return block.replace(entry=_entry(model.opt, state, cost))


def _approach(state: ContactState) -> Approach:
    assert state.material is not None
    velocity, restitution = state.velocity[:, 0], state.material.restitution
    return Approach(state.dist, velocity, restitution, state.inverse_weight)


def _entry(opt: Option, state: ContactState, cost) -> Entry:
    """What decides when contacts begin and end to act."""
    # Without a margin, the smallest violations are numbers.
    bare = state.replace(includemargin=jnp.zeros_like(state.includemargin))
    violation, velocity = state.dist - state.includemargin, state.velocity[:, 0]
    at = lambda violation: cost(bare.replace(dist=violation))  # noqa: E731
    normal = jax.vmap(functools.partial(response, opt))(state.solref, state.solimp, violation)
    return entry(opt.timestep, violation, velocity, at, normal, state.inverse_weight)


def _sliding(contact: Contact) -> Float[Array, "n 5"]:
    """Friction coefficients; zero where surfaces pull each other across a gap."""
    if contact.adhesion is None:
        return contact.friction
    touches = contact.dist < contact.includemargin
    return jnp.where(touches[:, None], contact.friction, 0.0)


def _rounding(pos: Float[Array, "n 3"]) -> Float[Array, "n"]:
    return _UNITS * jnp.finfo(pos.dtype).eps * (1 + jnp.max(jnp.abs(pos), axis=1))


def _material(model: Model, contact: Contact) -> Material:
    return contact_material(model, contact.geom1, contact.geom2)


def _jacobian(motion: Motion, contact: Contact, kind: ContactKind, bodies) -> ContactRows:
    links = [
        gather(motion.model.body_link, body) if movable else np.full(len(contact.dist), -1)
        for body, movable in zip(bodies, kind.movable, strict=True)
    ]
    arms = [_arms(motion, contact.pos, link) for link in links]
    return contact_rows(contact.frame, kind.condim, arms, links)


def _arms(motion: Motion, pos: Float[Array, "n 3"], link: Index) -> Float[Array, "n 3"]:
    """Points relative to the reference points of links; arbitrary where the link is -1."""
    origins = motion.link_origins()
    return pos - gather(origins, link % max(len(origins), 1))
