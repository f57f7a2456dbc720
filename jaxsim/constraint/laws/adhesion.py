"""Adhesion: contacts whose surfaces pull, each by up to a force.

The friction cone is moved along the normal by the adhesive force `d`. That is the sum of a constant
pull by `d`, a passive force (`jaxsim.forces.adhesion`), and of contact forces f in the cone that
push against it: the reference acceleration of the normal row is raised by `R d`, so that the net
force `f - d` of pressed surfaces does not depend on `d` (MuJoCo documentation, chapter
"Computation", section "Constraint model", "Adhesion"). Beyond the margin, where surfaces pull
across a gap, there is no friction.
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.constraint.laws.law import ContactState
from jaxsim.solver import EllipticCone, PyramidalCone, Unilateral

Cost = EllipticCone | PyramidalCone | Unilateral


def adhesive(contact: ContactState, cost: Cost, R: Float[Array, ""]) -> Cost:
    """The cost of one contact with adhesion, from that without.

    Args:
      contact: the contact.
      cost: the cost without adhesion.
      R: regularisation of its normal row, if it had no others.
    """
    if contact.adhesion is None:
        return cost
    apart = contact.dist >= contact.includemargin
    if isinstance(cost, PyramidalCone):
        edges = 2 * len(cost.mu)
        D = jnp.where(apart & (cost.D > 0), 1 / (edges * R), cost.D)
        cost = cost.replace(D=D, mu=jnp.where(apart, 0.0, cost.mu))
        first = edges * D
    else:
        first = cost.D[0]
        if isinstance(cost, EllipticCone):
            D = jnp.where(apart, np.eye(len(cost.D))[0] * cost.D, cost.D)
            cost = cost.replace(D=D, friction=jnp.where(apart, 0.0, cost.friction))
    pull = jnp.where(first > 0, contact.adhesion / jnp.where(first > 0, first, 1.0), 0.0)
    return cost.replace(aref=cost.aref + pull * np.eye(len(cost.aref))[0])
