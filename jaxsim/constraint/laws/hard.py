"""Hard contact: Coulomb's law and Signorini's, exactly, and Newton's law of restitution.

With `v+ = v + h a` the velocity after the step,

    K* contains u + mu |u_t| n, perpendicular to f, which K contains,    u = v+ - v^,
    v^_n = max(-phi / h, -e v_n if the surfaces meet within the step),  v^_t = 0

The rows here are a first, regularised problem; passes of the same solver take the regularisation
away and make friction obey Coulomb (`jaxsim.solver.passes`). The regularisation decides how fast.
Penetration, which only rounding and turning bodies leave, decays by a tenth each step, so that its
correction throws nothing into the air.
"""

import jax.numpy as jnp

from jaxsim.constraint.laws.law import ContactState
from jaxsim.constraint.laws.sap import within_reach
from jaxsim.model import Option
from jaxsim.solver import EllipticCone, Unilateral
from jaxsim.solver.passes import softness

_CORRECTION = 0.1


def contact_cost(opt: Option, contact: ContactState) -> EllipticCone | Unilateral:
    """The cost of one contact in a first pass."""
    h, v, phi = opt.timestep, contact.velocity, contact.dist
    assert contact.material is not None
    near = within_reach(opt, contact, h)
    R = softness(v.dtype) * contact.inverse_weight
    D0 = jnp.where(near, 1 / R, 0.0)
    meets = phi + h * v[0] < 0
    bounce = jnp.where(meets, -contact.material.restitution * v[0], -jnp.inf)
    apart = -phi / h * jnp.where(phi < 0, _CORRECTION, 1.0)
    target = jnp.maximum(apart, bounce)
    aref = jnp.where(near, (target - v[0]) / h, 0.0)[None]
    if contact.condim == 1:
        return Unilateral(aref=aref, D=D0[None])
    friction = contact.friction[: contact.condim - 1]
    return EllipticCone(
        aref=jnp.concatenate([aref, jnp.where(near, -v[1:] / h, 0.0)]),
        D=jnp.concatenate([D0[None], D0 * (friction / friction[0]) ** 2]),
        mu=friction[0],
        friction=friction,
    )
