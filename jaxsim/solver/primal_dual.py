"""Newton steps that see the kink of friction coming.

The friction cost of a sliding contact is nearly a norm, `p |x|`, where x is the scaled slip and p
the pressure. A quadratic model is good for it only as far as x does not turn, so that steps which
stop or turn many contacts at once have to be short, and in a heap nearly all of them are. Chan,
Golub and Mulet (1999, "A nonlinear primal-dual method for total variation-based image restoration")
write the force as `-p w` with

    m w = x,    m = max(|x|, the radius of the disc in which the contact sticks),

and linearise this in x and in the direction w. Without w, the step in x is that of the curvature

    p / m (1 - (g w^T + w g^T) / 2),    g = x / |x|,

in place of `p / m (1 - g g^T)`, and the next direction is `w = (x + dx - w dm) / m`, brought back
into the unit disc. At first `w = 0`, where the model bounds the norm from above. At the minimum
`w = g`, and steps are Newton's. The minimum and the condition for it are the same.
"""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.norms import norm_and_divisor
from jaxsim.solver.elliptic_cone import EllipticCone, curvature_of, tangent, zones
from jaxsim.solver.operator import Rows
from jaxsim.solver.problem import Problem


def no_directions(problem: Problem) -> Rows:
    """The first directions w of each block, zeros; empty for blocks that are not cones."""
    return tuple(_of_cone(kind, jnp.zeros_like) for kind in problem.blocks)


def curvatures(problem: Problem, rows: Rows, directions: Rows) -> Rows:
    """Curvatures of all blocks, given `J x`; those of cones with the directions w."""
    found = []
    for kind, r, w in zip(problem.blocks, problem.residuals(rows), directions, strict=True):
        if isinstance(kind, EllipticCone):
            found.append(jax.vmap(curvature_of)(kind.D, kind.mu, kind.friction, r, w))
        else:
            found.append(kind.curvature(r))
    return tuple(found)


def next_directions(problem: Problem, rows: Rows, steps: Rows, directions: Rows) -> Rows:
    """The directions after a step, given `J x` and `J dx`."""
    residuals = problem.residuals(rows)
    return tuple(
        _of_cone(kind, lambda friction: jax.vmap(_next)(kind.mu, friction, r, v, w))  # noqa: B023
        for kind, r, v, w in zip(problem.blocks, residuals, steps, directions, strict=True)
    )


def _of_cone(kind, function) -> Array:
    """A function of the friction coefficients of a cone."""
    return function(kind.friction) if isinstance(kind, EllipticCone) else jnp.zeros(0)


def _next(
    mu: Float[Array, ""],
    friction: Float[Array, "m"],
    r: Float[Array, "d"],
    v: Float[Array, "d"],
    w: Float[Array, "m"],
) -> Float[Array, "m"]:
    """The direction of one contact after a step v from the residual r; zero where it is open."""
    length, safe, _ = tangent(friction, r)
    sticks, slides = zones(mu, r[0], length)
    x, dx = friction * r[1:], friction * v[1:]
    m = jnp.where(sticks, -mu * mu * r[0], safe)
    dm = jnp.where(sticks, -mu * mu * v[0], x @ dx / safe)
    found = (x + dx - w * dm) / jnp.where(m > 0, m, 1.0)
    size, _ = norm_and_divisor(found)
    return jnp.where(sticks | slides, found / jnp.maximum(size, 1), 0.0)
