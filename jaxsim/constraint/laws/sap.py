"""SAP: Drake's semi-analytic primal contact, a law on velocities.

Castro, Permenter, Han 2022, "An unconstrained convex formulation of compliant contact". The
velocity after the step minimises a convex cost, in which a contact with distance phi has

    v^_n = -phi / (h + tau),  v^_t = 0,    R_n = max(beta^2 w / 4 pi^2, 1 / (h k (h + tau))),
    R_t = sigma w

so that a spring k with the relaxation time tau is integrated implicitly, as hard as the time step
can resolve; w is the inverse inertia. It is the same cone and the same problem as MuJoCo's elliptic
contact, with other numbers: with `v+ = v + h a` the reference is `aref = (v^ - J v) / h`.

Its artefacts in closed form: what slides hovers at `(h + tau) mu |v_t|`, what sticks creeps at
`sigma h F / m` under a force F. Anitescu's relaxation is its limit for stiff springs.
"""

import math

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.constraint.laws.law import ContactState
from jaxsim.model import Option
from jaxsim.solver import EllipticCone, Unilateral

# beta: contacts harder than a period of one time step are as hard as that.
_NEAR_RIGID = 1 / (4 * math.pi**2)
# sigma: the regularisation of friction that sticks.
STICTION = 1e-3


def contact_cost(opt: Option, contact: ContactState) -> EllipticCone | Unilateral:
    """The cost of one contact."""
    aref, D0 = normal_row(opt, contact)
    if contact.condim == 1:
        return Unilateral(aref=aref[None], D=D0[None])
    friction = contact.friction[: contact.condim - 1]
    Dt, aref_t = friction_rows(opt, contact, D0)
    # The cone's friction coefficient is mu sqrt(R_t / R_n).
    mu = friction[0] * jnp.sqrt(D0 / jnp.where(Dt[0] > 0, Dt[0], 1.0))
    return EllipticCone(
        aref=jnp.concatenate([aref[None], aref_t]),
        D=jnp.concatenate([D0[None], Dt]),
        mu=jnp.where(Dt[0] > 0, mu, friction[0]),
        friction=friction,
    )


def normal_row(opt: Option, contact: ContactState) -> tuple[Float[Array, ""], Float[Array, ""]]:
    """Reference acceleration and `1 / R` of the normal row."""
    h, material = opt.timestep, contact.material
    assert material is not None
    time = h + material.relaxation
    R = jnp.maximum(_NEAR_RIGID * contact.inverse_weight, 1 / (h * material.stiffness * time))
    near = within_reach(opt, contact, time)
    aref = (-contact.dist / time - contact.velocity[0]) / h
    return jnp.where(near, aref, 0.0), jnp.where(near, 1 / R, 0.0)


def friction_rows(
    opt: Option, contact: ContactState, D0: Float[Array, ""]
) -> tuple[Float[Array, "m"], Float[Array, "m"]]:
    """`1 / R` and reference accelerations of the friction rows, which stop all motion."""
    friction = contact.friction[: contact.condim - 1]
    R = STICTION * contact.inverse_weight
    D = jnp.where(D0 > 0, 1 / R, 0.0) * (friction / friction[0]) ** 2
    return D, jnp.where(D0 > 0, -contact.velocity[1:] / opt.timestep, 0.0)


def within_reach(opt: Option, contact: ContactState, time: Float[Array, ""]):
    """Whether the surfaces may push within a time step.

    Rows of open contacts are legal and take part: they push as soon as `phi + time v_n` would be
    less than zero, or less than what sliding lifts. The bound is their present speed and gravity.
    """
    mu = contact.friction[0]
    speed = jnp.sqrt(jnp.sum(contact.velocity[:3] ** 2) + 1e-30)
    fall = opt.timestep * jnp.sqrt(jnp.sum(opt.gravity**2) + 1e-30)
    return contact.dist < contact.includemargin + time * (1 + mu) * (speed + fall)
