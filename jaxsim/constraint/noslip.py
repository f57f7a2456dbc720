"""Friction that does not creep: MuJoCo's noslip solver, at its fixed point.

After the main solve, friction is determined once more without regularisation: dry friction of
joints and tendons within its bounds, that of contacts within what the normal forces of the main
solve allow. These and all other forces stay (`mj_solNoSlip` in MuJoCo's `engine_solver.c`). So it
is the minimum of

    1/2 |a - a_f|_M^2 + sum_i sigma_i(J_i a - aref_i),   M a_f = force + J^T (all other forces),

sigma_i(r) the largest power of friction, a box or an ellipse of forces, at the residual r.

MuJoCo makes `noslip_iterations` projected Gauss-Seidel sweeps from the forces of the main solve.
Here the minimum is found, by Newton's method and passes (`jaxsim.solver.passes`), whatever their
number: few sweeps depend on the order of the contacts and leave some creep. The derivative is that
of the minimum.
"""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.constraint.block import Block
from jaxsim.constraint.operators import TreeOperator
from jaxsim.solver import Disc, EllipticCone, Huber, Kind, Problem, PyramidalCone
from jaxsim.solver.operator import Lifted, Rows
from jaxsim.solver.passes import (
    Minimise,
    RigidSolution,
    attach_rigid,
    rigid_tolerance,
    shift_of,
    softness,
    solve_rigid,
)

PASSES = 100


def without_slip(
    blocks: list[Block],
    operator: TreeOperator,
    force: Float[Array, "nv"],
    y: Lifted,
    minimiser: Callable[[Float[Array, "nv"]], Minimise],
) -> tuple[Lifted, Rows, RigidSolution]:
    """The acceleration and the forces without creep.

    Args:
      blocks: all rows.
      operator: with their Jacobians.
      force: all forces but those of constraints.
      y: the solution of the main problem, lifted.
      minimiser: from all forces but those of these problems to how one of them is solved.
    """
    rows = operator.rows(y)
    forces = Problem(tuple(block.kind for block in blocks)).forces(rows)
    dry = [
        i for i, b in enumerate(blocks) if isinstance(b.kind, Huber | PyramidalCone | EllipticCone)
    ]
    fixed, kinds = list(forces), [b.kind.replace(D=jnp.zeros_like(b.kind.D)) for b in blocks]
    shifts = []
    for i in dry:
        kinds[i] = _dry(blocks[i], rows[i], forces[i])
        fixed[i] = _normal(blocks[i].kind, forces[i])
        shifts.append(shift_of(kinds[i], forces[i] - fixed[i]))
    force = force + operator.pull(tuple(fixed))
    problem, rigid = Problem(tuple(kinds)), tuple(dry)
    found = solve_rigid(
        problem,
        operator,
        rigid,
        minimiser(force),
        operator.vector(y),
        tuple(shifts),
        passes=PASSES,
        tolerance=rigid_tolerance(force.dtype),
    )
    y, friction = attach_rigid(found, problem, operator, force, rigid)
    return y, tuple(map(jnp.add, fixed, friction)), found


def _normal(kind: Kind, force: Array) -> Array:
    """The part of a block's forces that stays."""
    if isinstance(kind, Huber):
        return jnp.zeros_like(force)
    return force.at[:, 1:].set(0)


def _dry(block: Block, jx: Array, force: Array) -> Kind:
    """The friction of a block alone, bounded by the forces that stay."""
    kind = block.kind
    assert block.weight is not None
    D = 1 / (softness(jx.dtype) * block.weight)
    if isinstance(kind, Huber):
        return kind.replace(D=jnp.where(kind.D > 0, D, 0.0))
    active = kind.D.reshape(len(D), -1)[:, :1] > 0
    friction = kind.friction if isinstance(kind, EllipticCone) else kind.mu
    if isinstance(kind, PyramidalCone):
        D = jnp.broadcast_to(D[:, None], friction.shape)
        bounds = friction * kind.normals(jx - kind.aref)
        return Huber(kind.aref, _without_normal(active, D), _without_normal(active, bounds))
    D = D[:, None] * (friction / friction[:, :1]) ** 2
    return Disc(kind.aref, _without_normal(active, D), friction, force[:, 0])


def _without_normal(active, values: Float[Array, "n d-1"]) -> Float[Array, "n d"]:
    """Values of friction rows beside zeros for the normal ones; zeros where nothing is active."""
    return jnp.pad(jnp.where(active, values, 0.0), ((0, 0), (1, 0)))
