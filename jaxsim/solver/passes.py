"""Rigid rows, without regularisation and with exact Coulomb friction, by several passes.

The force of a regularised row is that of a spring, `f = F(J x - aref)`, so the row yields under
load. Each pass solves the problem again with shifted references

    aref + R f - s n,    f the force of the last pass, s = T(J x - aref) its slip,

where n is the normal row and T the scaled length of the friction residual. The shift R f is that of
the augmented Lagrangian (Rockafellar 1976): at the fixed point, a row that holds does not move, and
the solution does not depend on R. The shift s n, for cones only, is De Saxce's: without it, the
convex problem makes sliding contacts separate; with it, the fixed point satisfies the laws of
Coulomb and Signorini,

    K* contains u + T(u) n, K contains f, both are orthogonal,    u = J x - aref,

with the friction cone K (Acary, Cadoux 2013, "Applications of an existence result for the Coulomb
friction problem").

Shifts are stored as `z = sqrt(D) (R f - s n)`. In these variables, passes are a contraction for
rows without slip, which Anderson's acceleration makes faster. The derivative is that of the fixed
point: `z = G(z, theta)` gives `(1 - dG/dz) dz = dG/dtheta`, which is solved by passes on tangents.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float, Int

from jaxsim.arrays.precision import full_precision
from jaxsim.batching.primitives.jvp_rule import moving_leaves, with_jvp_rule
from jaxsim.solver.anderson import Memory
from jaxsim.solver.elliptic_cone import EllipticCone
from jaxsim.solver.implicit import attach_lifted
from jaxsim.solver.newton import Solution, SolverStatus
from jaxsim.solver.operator import Lifted, Operator, Rows
from jaxsim.solver.problem import Kind, Problem

Minimise = Callable[[Problem, Float[Array, "nv"]], Solution]
"""From a problem and an initial guess to its solution: `newton.solve` with the other arguments.

It may stop early, not converged, with a `reduction`: the next pass goes on from there.
"""

Shifts = tuple[Array, ...]
"""`sqrt(D) (R f - s n)` of each rigid block, in the shape of its `aref`."""

# Within so many tolerances, a pass that does not lower the residual has met rounding: it is done.
_ROUNDING = 18.0
# So are two passes in turn after so many: forces that contacts share change long after velocities.
_MANY = 20
# Relative residual of the tangents' equation at which their passes end, in units of rounding.
_TANGENT_ROUNDING = 50.0
_TANGENT_PASSES = 300


class RigidSolution(NamedTuple):
    """A fixed point of the passes.

    Attributes:
        x: The minimiser of the last pass.
        shifts: The shifts.
        status: Status of the last pass, with the iterations and linear solves of all passes.
        passes: Number of passes.
        residual: Change of the forces by one more pass, relative to the largest force.
        converged: Whether the residual is below the tolerance, or as small as rounding allows.
    """

    x: Float[Array, "nv"]
    shifts: Shifts
    status: SolverStatus
    passes: Int[Array, ""]
    residual: Float[Array, ""]
    converged: Bool[Array, ""]

    def whole_status(self) -> SolverStatus:
        """That of the passes by themselves."""
        return self.status.replace(
            converged=self.converged, passes=self.passes, rigid_residual=self.residual
        )

    def status_after(self, first: SolverStatus) -> SolverStatus:
        """The combined status of a first solve and of the passes after it."""
        last = self.whole_status()
        return last.replace(
            iterations=first.iterations + last.iterations,
            finite=first.finite & last.finite,
            converged=first.converged & last.converged,
            linear=first.linear.then(last.linear),
        )


def softness(dtype) -> float:
    """Regularisation of rigid rows in units of their inverse inertia.

    It determines how fast passes converge. If it is too small, the Hessian loses the inertia of
    motions that the rows leave free to rounding.
    """
    return 2e-2 if jnp.finfo(dtype).bits <= 32 else 2e-4


def rigid_tolerance(dtype) -> float:
    """Tolerance of the forces relative to the largest force, for this number type."""
    return 50 * float(jnp.finfo(dtype).eps) / softness(dtype)


def shift_of(kind: Kind, force: Array, slip: Float[Array, "n"] | None = None) -> Array:
    """The shift for the forces and the slips (or None) of a block."""
    root, inverse = _roots(kind.D)
    return inverse * force - root * _on_normal(slip, force)


def first_shifts(problem: Problem, rigid: Sequence[int]) -> Shifts:
    """Those of no forces and of the slip of no acceleration."""
    kinds = [problem.blocks[i] for i in rigid]
    nothing = [jnp.zeros_like(kind.aref) for kind in kinds]
    return tuple(
        shift_of(kind, zero, _slip(kind, zero - kind.aref))
        for kind, zero in zip(kinds, nothing, strict=True)
    )


def shifted(problem: Problem, rigid: Sequence[int], shifts: Shifts) -> Problem:
    """The problem with the references of its rigid blocks shifted."""
    blocks: list[Any] = list(problem.blocks)
    for i, z in zip(rigid, shifts, strict=True):
        _, inverse = _roots(blocks[i].D)
        blocks[i] = blocks[i].replace(aref=blocks[i].aref + inverse * z)
    return Problem(tuple(blocks))


def solve_rigid(
    problem: Problem,
    operator: Operator,
    rigid: tuple[int, ...],
    minimise: Minimise,
    x: Float[Array, "nv"],
    shifts: Shifts,
    *,
    passes: int,
    tolerance: float,
) -> RigidSolution:
    """Repeat passes until the forces of the rigid rows no longer change.

    The result has no derivative; `attach_rigid` adds it.

    Args:
        problem: The blocks of constraint rows.
        operator: Mass matrix and Jacobian.
        rigid: Indices of the blocks that become rigid. Their regularisation affects only how fast
            passes converge.
        minimise: Solves the problem of one pass.
        x: Initial guess of the solution.
        shifts: Shifts of the first pass.
        passes: Largest number of passes, at least one.
        tolerance: Bound on the change of the forces relative to the largest force.
    """
    problem, operator, x, shifts = lax.stop_gradient((problem, operator, x, shifts))
    flat, unravel = ravel_pytree(shifts)

    def advance(state):
        last, memory, u = state
        shifts = unravel(u)
        found = minimise(shifted(problem, rigid, shifts), last.x)
        rows = operator.rows(operator.lift(found.x))
        after = _after(rows, problem, rigid, shifts)
        residual = _residual(rows, problem, rigid, shifts, after)
        memory, u = memory.next(u, ravel_pytree(after)[0])
        status = found.status.replace(
            iterations=last.status.iterations + found.status.iterations,
            linear=last.status.linear.then(found.status.linear),
        )
        near = (last.passes > 0) & (residual < _ROUNDING * tolerance)
        stalled = near & (residual >= last.residual) & found.status.converged
        slow = near & (last.passes >= _MANY) & (last.residual < _ROUNDING * tolerance)
        # What a pass has left of its gradient, the next one reduces again.
        exact = found.status.converged | (last.passes > 0) & (last.residual <= tolerance)
        done = (residual <= tolerance) & exact | stalled | slow
        passes = last.passes + 1
        return RigidSolution(found.x, after, status, passes, residual, done), memory, u

    def unfinished(state):
        last = state[0]
        return ~last.converged & (last.passes < passes) & last.status.finite

    shape = jax.eval_shape(minimise, problem, x).status
    start = RigidSolution(
        x, shifts, _blank(shape), jnp.zeros((), jnp.int32), x.sum() * 0, jnp.zeros((), bool)
    )
    return lax.while_loop(unfinished, advance, (start, Memory.empty(flat), flat))[0]


def attach_rigid(
    found: RigidSolution,
    problem: Problem,
    operator: Operator,
    force: Float[Array, "nv"],
    rigid: tuple[int, ...],
) -> tuple[Lifted, Rows]:
    """Return the lifted solution and the forces of all rows with their derivatives.

    Args:
        found: The fixed point.
        problem: The blocks of constraint rows.
        operator: Mass matrix and Jacobian.
        force: Generalised forces other than constraint forces.
        rigid: Indices of the rigid blocks.
    """
    x, shifts = lax.stop_gradient((found.x, found.shifts))
    shifts = _attached(x, shifts, (problem, operator, force), rigid)
    problem = shifted(problem, rigid, shifts)
    y = attach_lifted(x, problem, operator, force)
    return y, problem.forces(operator.rows(y))


def _attached(x: Float[Array, "nv"], shifts: Shifts, theta, rigid: tuple[int, ...]) -> Shifts:
    """The shifts with their derivatives with respect to theta: problem, operator and force."""
    leaves, structure = jax.tree.flatten((x, shifts, theta))
    count = len(shifts)

    @full_precision
    def rule(primals, tangents):
        x, shifts, theta = structure.unflatten(primals)
        moved, given, where = moving_leaves(theta, tangents[1 + count :])
        _, b = jax.jvp(lambda *some: _pass(x, shifts, where(*some), rigid), moved, given)

        def remaining(t):
            _, after = jax.jvp(lambda z: _pass(x, z, theta, rigid), (shifts,), (t,))
            return jax.tree.map(jnp.subtract, t, after)

        return list(shifts), list(lax.custom_linear_solve(remaining, b, _by_passes, _by_passes))

    return tuple(with_jvp_rule(lambda *xs: list(xs[1 : 1 + count]), rule)(*leaves))


def _pass(x: Float[Array, "nv"], shifts: Shifts, theta, rigid: tuple[int, ...]) -> Shifts:
    """The shifts after one more pass, whose minimiser x is known."""
    problem, operator, force = theta
    y = attach_lifted(x, shifted(problem, rigid, shifts), operator, force)
    return _after(operator.rows(y), problem, rigid, shifts)


def _by_passes(remaining: Callable[[Shifts], Shifts], b: Shifts) -> Shifts:
    """The solution t of `remaining(t) = b`, by the fixed-point iteration `t + b - remaining(t)`."""
    flat, unravel = ravel_pytree(b)
    enough = _TANGENT_ROUNDING * jnp.finfo(flat.dtype).eps * jnp.max(jnp.abs(flat), initial=0)

    def unfinished(state):
        _, _, left, k = state
        return (left > enough) & (k < _TANGENT_PASSES)

    def advance(state):
        t, memory, _, k = state
        left = flat - ravel_pytree(remaining(unravel(t)))[0]
        memory, after = memory.next(t, t + left)
        return after, memory, jnp.max(jnp.abs(left), initial=0), k + 1

    start = flat, Memory.empty(flat), jnp.max(jnp.abs(flat), initial=0), jnp.zeros((), jnp.int32)
    return unravel(lax.while_loop(unfinished, advance, start)[0])


def _after(rows: Rows, problem: Problem, rigid: Sequence[int], shifts: Shifts) -> Shifts:
    """The shifts of the next pass, from forces and slips at `J x`."""
    forces = shifted(problem, rigid, shifts).forces(rows)
    after = []
    for i in rigid:
        kind = problem.blocks[i]
        after.append(shift_of(kind, forces[i], _slip(kind, rows[i] - kind.aref)))
    return tuple(after)


def _slip(kind: Kind, r: Array) -> Float[Array, "n"] | None:
    """Scaled lengths of friction residuals, of cones."""
    return kind.slip(r) if isinstance(kind, EllipticCone) else None


def _residual(rows: Rows, problem: Problem, rigid, shifts: Shifts, after: Shifts):
    """Change of the forces at `J x` by one more pass, relative to the largest force."""
    forces, then = (shifted(problem, rigid, z).forces(rows) for z in (shifts, after))
    change = _largest([then[i] - forces[i] for i in rigid])
    size = _largest([forces[i] for i in rigid])
    return change / jnp.where(size > 0, size, 1.0)


def _largest(arrays: Sequence[Array]) -> Float[Array, ""]:
    return jnp.max(jnp.stack([jnp.max(jnp.abs(a), initial=0) for a in arrays]))


def _on_normal(slip: Float[Array, "n"] | None, force: Array) -> Array:
    """The slips in the normal rows of a block, zeros in its other rows."""
    if slip is None:
        return jnp.zeros_like(force)
    return jnp.pad(slip[:, None], ((0, 0), (0, force.shape[1] - 1)))


def _roots(D: Array) -> tuple[Array, Array]:
    """`sqrt(D)` and `sqrt(R)`; zeros where a row contributes nothing."""
    root = jnp.sqrt(jnp.where(D > 0, D, 1.0))
    return jnp.where(D > 0, root, 0.0), jnp.where(D > 0, 1 / root, 0.0)


def _blank(shape: SolverStatus) -> SolverStatus:
    """The status before the first pass."""
    blank = jax.tree.map(lambda a: jnp.zeros(a.shape, a.dtype), shape)
    return blank.replace(
        finite=jnp.ones((), bool), linear=blank.linear._replace(converged=jnp.ones((), bool))
    )
