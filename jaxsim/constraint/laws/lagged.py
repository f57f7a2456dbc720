"""Lagged friction: its strength is that of the normal force before the step.

Drake's default, "lagged" (Castro, Han, Masterjohn 2024, "Irrotational contact fields"): normal rows
as in `sap`, and friction in a disc of known radius `mu n`, n the normal force that the row would
have at the velocity before the step. The problem stays convex, and what slides does not hover. Each
step's friction is coupled to its normal forces with a delay, which shows in impacts.

Of Drake's law the dissipation is that of `sap`, a relaxation time instead of Hunt and Crossley's,
and friction that sticks has a spring, instead of a smooth sign.
"""

import jax.numpy as jnp

from jaxsim.constraint.laws import sap
from jaxsim.constraint.laws.law import ContactState
from jaxsim.model import Option
from jaxsim.solver import Disc, Unilateral


def contact_cost(opt: Option, contact: ContactState) -> Disc | Unilateral:
    """The cost of one contact."""
    aref, D0 = sap.normal_row(opt, contact)
    if contact.condim == 1:
        return Unilateral(aref=aref[None], D=D0[None])
    Dt, aref_t = sap.friction_rows(opt, contact, D0)
    return Disc(
        aref=jnp.concatenate([aref[None], aref_t]),
        D=jnp.concatenate([D0[None], Dt]),
        friction=contact.friction[: contact.condim - 1],
        normal=D0 * jnp.maximum(aref, 0.0),
    )
