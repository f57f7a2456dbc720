"""Friction without creep: the fixed point of MuJoCo's noslip solver.

After the main solve, friction forces are computed again without regularisation. Those of joints and
tendons are bounded as before, those of contacts by the normal forces of the main solve. All other
forces are held fixed (`mj_solNoSlip` in MuJoCo's `engine_solver.c`). The acceleration a is then the
minimiser of

    1/2 |a - a_f|_M^2 + sum_i sigma_i(J_i a - aref_i),   M a_f = force + J^T (all other forces),

where sigma_i(r) is the largest power of friction forces within their bounds, a box or an ellipse,
at the residual r.

MuJoCo makes `noslip_iterations` projected Gauss-Seidel sweeps from the forces of the main solve;
few sweeps depend on the order of the contacts and leave some creep. Here the minimum is found by
Newton's method in several passes (`jaxsim.solver.passes`), whatever that number. The derivative is
that of the minimum.
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
      blocks: all blocks of rows.
      operator: the operator with their Jacobians.
      force: generalised forces other than constraint forces.
      y: the lifted solution of the main problem.
      minimiser: from the generalised forces of a problem to a function that solves it.

    Returns:
      The lifted acceleration, the forces of all rows, and the solution of the friction problem.
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
    """The part of a block's forces that is held fixed."""
    if isinstance(kind, Huber):
        return jnp.zeros_like(force)
    return force.at[:, 1:].set(0)


def _dry(block: Block, jx: Array, force: Array) -> Kind:
    """Cost of a block's friction only, bounded by the fixed normal forces."""
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
    """Values of friction rows with zeros for the normal row; all zero where not active."""
    return jnp.pad(jnp.where(active, values, 0.0), ((0, 0), (1, 0)))
