"""MuJoCo's soft contact: frictionless, or with a pyramidal or an elliptic friction cone.

The reference acceleration of each row is that of a spring and a damper, and its regularisation
determines how soft the row is (MuJoCo documentation, chapter "Computation", sections "Constraint
model" and "Friction cones"); see `jaxsim.constraint.impedance`.
"""

import jax.numpy as jnp
import mujoco
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.constraint.impedance import inverse_where, response
from jaxsim.constraint.laws.adhesion import Cost, adhesive
from jaxsim.constraint.laws.law import ContactState
from jaxsim.model import Option
from jaxsim.solver import EllipticCone, PyramidalCone, Unilateral

ELLIPTIC = int(mujoco.mjtCone.mjCONE_ELLIPTIC)

# Lower bound of a row's regularisation relative to its inverse inertia, in units of rounding. Below
# it, the Hessian would lose the inertia of motions that the row leaves free.
_UNITS = 30
# Contacts with less than this many units are no deeper at rest than distances are known.
_STIFF = 8192


def contact_cost(opt: Option, contact: ContactState) -> Cost:
    """The cost of one contact, which is active if its distance is below its margin."""
    if contact.condim == 1:
        return _frictionless(opt, contact)
    return _elliptic(opt, contact) if opt.cone == ELLIPTIC else _pyramidal(opt, contact)


def _frictionless(opt: Option, contact: ContactState) -> Cost:
    """The cost of a normal row without friction."""
    violation = contact.dist - contact.includemargin
    r = response(opt, contact.solref, contact.solimp, violation)
    R = r.regularisation(contact.inverse_weight)
    active = _touches(contact, R)
    aref = r.reference(contact.velocity, violation)
    D = inverse_where(active, R)
    return adhesive(contact, Unilateral(aref=jnp.where(active, aref, 0.0), D=D[None]), R)


def _pyramidal(opt: Option, contact: ContactState) -> Cost:
    """The cost with a pyramidal cone; all edges share one regularisation.

    The regularisation is proportional to the square of friction. The lower bound keeps contacts
    with little friction from becoming stiffer than floating-point numbers can represent.
    """
    violation, velocity, friction = _of(contact)
    r = response(opt, contact.solref, contact.solimp, violation)
    mu = friction[0] / jnp.sqrt(jnp.maximum(opt.impratio, MINVAL))
    weight = contact.inverse_weight * (1 + friction[0] * friction[0])
    R = 2 * mu * mu * r.regularisation(weight)
    R = jnp.maximum(R, _UNITS * jnp.finfo(R.dtype).eps * contact.inverse_weight)
    active = _touches(contact, R)
    aref = jnp.concatenate([r.reference(velocity[:1], violation), r.reference(velocity[1:], 0.0)])
    aref = jnp.where(active, aref, 0.0)
    cost = PyramidalCone(aref=aref, D=inverse_where(active, R), mu=friction)
    return adhesive(contact, cost, r.regularisation(contact.inverse_weight))


def _elliptic(opt: Option, contact: ContactState) -> Cost:
    """The cost with an elliptic cone; friction rows only damp, by `solreffriction` if it is set."""
    violation, velocity, friction = _of(contact)
    normal = response(opt, contact.solref, contact.solimp, violation)
    own = contact.solreffriction
    has_own = (own != 0).any() & ((own[0] > 0) == (own[1] > 0))
    tangent = response(opt, jnp.where(has_own, own, contact.solref), contact.solimp, violation)
    aref = jnp.concatenate(
        [normal.reference(velocity[:1], violation), tangent.reference(velocity[1:], 0.0)]
    )
    R0 = normal.regularisation(contact.inverse_weight)
    active = _touches(contact, R0)
    R1 = R0 / jnp.maximum(opt.impratio, MINVAL)
    # friction[j]^2 R[j] is the same in all directions.
    R = jnp.concatenate([R0[None], R1 * (friction[:1] / friction) ** 2])
    cost = EllipticCone(
        aref=jnp.where(active, aref, 0.0),
        D=inverse_where(active, R),
        mu=friction[0] * jnp.sqrt(R1 / R0),
        friction=friction,
    )
    return adhesive(contact, cost, R0)


def _touches(contact: ContactState, R: Float[Array, ""]) -> Bool[Array, ""]:
    """Whether the contact is closer than its margin, or a stiff one as close as rounding can tell.

    At rest a stiff contact is less deep than rounding. If that decided which corners of a body
    touch, the others would fall until the next step. Bodies that are placed at a distance of zero
    do not touch yet, as in MuJoCo. Adhesion acts across its gap.
    """
    violation = contact.dist - contact.includemargin
    stiff = _STIFF * jnp.finfo(R.dtype).eps * contact.inverse_weight > R
    reach = jnp.where(stiff, contact.rounding, 0)
    touches = (violation < reach) & (violation != 0)
    return touches if contact.gap is None else touches | (violation < contact.gap)


def _of(contact: ContactState):
    """Violation of the normal row, velocities of all rows, coefficients of the friction rows."""
    violation = contact.dist - contact.includemargin
    return violation, contact.velocity, contact.friction[: contact.condim - 1]
