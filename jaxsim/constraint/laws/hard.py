"""Hard contact: Coulomb's law and Signorini's, exactly, and Newton's law of restitution.

With `v+ = v + h a` the velocity after the step,

    K* contains u + mu |u_t| n, perpendicular to f, which K contains,    u = v+ - v^,
    v^_t = 0,    v^_n by the time of impact and the restitution (`jaxsim.constraint.rigid.impact`)

The rows here are a first, regularised problem; passes of the same solver take the regularisation
away and make friction obey Coulomb (`jaxsim.solver.passes`). The regularisation decides how fast.
"""

import jax.numpy as jnp

from jaxsim.constraint.laws.law import ContactState
from jaxsim.constraint.laws.sap import within_reach
from jaxsim.model import Option
from jaxsim.solver import EllipticCone, Unilateral
from jaxsim.solver.passes import softness


def contact_cost(opt: Option, contact: ContactState) -> EllipticCone | Unilateral:
    """The cost of one contact in a first pass, with a target of zero in all rows."""
    h, v = opt.timestep, contact.velocity
    near = within_reach(opt, contact, h)
    R = softness(v.dtype) * contact.inverse_weight
    D0 = jnp.where(near, 1 / R, 0.0)
    aref = jnp.where(near, -v / h, 0.0)
    if contact.condim == 1:
        return Unilateral(aref=aref, D=D0[None])
    friction = contact.friction[: contact.condim - 1]
    return EllipticCone(
        aref=aref,
        D=jnp.concatenate([D0[None], D0 * (friction / friction[0]) ** 2]),
        mu=friction[0],
        friction=friction,
    )
