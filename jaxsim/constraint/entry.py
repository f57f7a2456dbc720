"""The derivative of the times at which contacts and limits begin and end to act.

In the continuous motion these times move with the state. If a row begins to act dt earlier, with an
acceleration that jumps by da, the velocity changes by `da dt` (the saltation term of hybrid
systems). Time steps do not know this: the row acts from the next step on, wherever within the step
the surfaces met. It is restored here without a change of the values.

    t = r / v          time since the row began to act: its violation r over its rate v
    s = t / h          the same as a share of the time step h, in a row's first step
    u = f / -df        share of a step until the force f ends, df its change, in its last step

A velocity of a semi-implicit step belongs to the middle between two positions, so the force at a
step stands for half a step on either side. In the first step of a row it acts for the part
`s + 1/2` of that, in the last for `u + 1/2`. So the velocity gets, beside the derivative of the
step, that of

    H^-1 J^T (f0 t + h (s - 1/2) f)      and      h H^-1 J^T (u - 1/2) f

where t and f have derivatives and all else is constant, and f0 is the force at violation zero.
`docs/gradients.md` has the derivation.
"""

from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jax.ad_checkpoint import checkpoint_name
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.checkpoint import SOLUTION
from jaxsim.arrays.constants import MINVAL
from jaxsim.batching.primitives.jvp_rule import with_jvp_rule
from jaxsim.constraint.impedance import Response
from jaxsim.solver import Kind, Operator, Problem, solve_hessian
from jaxsim.solver.operator import Rows

# An entry counts if a step changes the rate of its row by less than this part.
_PART = 0.25


@struct.dataclass
class Entry:
    """What decides when n rows begin and end to act.

    Attributes:
      new: whether the row became active within the last step.
      time: how long ago (s), zero for others.
      velocity: rate of the violation.
      kind: cost of the rows, as if the violation of new ones were zero still.
      response: stiffness, damping and impedance.
      inverse_inertia: of the rows.
    """

    new: Bool[Array, "n"]
    time: Float[Array, "n"]
    velocity: Float[Array, "n"]
    kind: Kind
    response: Response
    inverse_inertia: Float[Array, "n"]


def entry(
    h: Float[Array, ""],
    violation: Float[Array, "n"],
    velocity: Float[Array, "n"],
    kind_at: Callable[[Float[Array, "n"]], Kind],
    response: Response,
    inverse_inertia: Float[Array, "n"],
) -> Entry:
    """The entry of unilateral rows, active where their violation is negative.

    A semi-implicit step arrives with the velocity of its end, so the violation was
    `violation - h velocity` one step ago.

    Args:
      h: time step.
      violation: distance minus margin; negative numbers are violations.
      velocity: its rate.
      kind_at: cost of the rows as a function of the violation.
      response: stiffness, damping and impedance of each row.
      inverse_inertia: of each row.
    """
    new = (violation < 0) & (violation - h * velocity >= 0)
    time = jnp.where(new, violation / jnp.where(new, velocity, -1.0), 0.0)
    # Rows with a violation of exactly zero are not active.
    first = -jnp.sqrt(jnp.finfo(violation.dtype).tiny)
    kind = kind_at(jnp.where(new, first, violation))
    return Entry(new, time, velocity, kind, response, jnp.maximum(inverse_inertia, MINVAL))


def entry_acceleration(
    h: Float[Array, ""],
    entries: Sequence[Entry | None],
    kinds: Sequence[Kind],
    forces: Rows,
    operator: Operator,
    x: Float[Array, "nv"],
    minimised: Callable[[Problem], Float[Array, "nv"]],
) -> Float[Array, "nv"]:
    """Zero; its tangent times h is what the velocity gets, see the module's description.

    Let f be the forces of the rows at the acceleration where the violation of new rows is zero, and
    H the Hessian there without rows that begin or end to act. Then `da = H^-1 J^T f` over the new
    rows, and row i has the part `H^-1 J_i^T f_i`.

    Args:
      h: time step.
      entries: of each block, None for rows that are always active.
      kinds: cost of each block.
      forces: forces of the rows of each block, with their derivatives.
      operator: mass matrix and Jacobian of the blocks.
      x: acceleration.
      minimised: function from a problem to its minimiser.
    """
    acting = {i: entry for i, entry in enumerate(entries) if entry is not None}
    change = operator.rows(operator.lift(h * x))
    moving = {
        i: (entry.time, forces[i], entry.velocity + 0.5 * _normal(change[i]))
        for i, entry in acting.items()
    }
    held = lax.stop_gradient((acting, list(kinds), forces, operator, h, change))
    acting, kinds, forces, operator, h, change = held
    problem = Problem(tuple(acting[i].kind if i in acting else k for i, k in enumerate(kinds)))
    first = operator.rows(operator.lift(_kept(minimised(problem))))
    jumps, curvatures = problem.forces(first), list(problem.curvatures(first))
    factors = {}
    for i, entry in acting.items():
        entry = entry.replace(new=entry.new & _resolved(h, entry, jumps[i]))
        ends = _share_until_end(h, entry, forces[i], change[i])
        factors[i] = _factors(h, entry, jumps[i], forces[i], ends)
        switches = _spread(entry.new | (ends < 1), curvatures[i])
        curvatures[i] = jnp.where(switches, 0.0, curvatures[i])
    nothing = tuple(jnp.zeros_like(f) for f in forces)
    return _moved(moving, (operator, tuple(curvatures), nothing, factors))


def _factors(h, entry: Entry, jump, force, ends) -> tuple[Array, Array, Array]:
    """Factors of the tangents of a block's entry times, forces and rates in its extra force."""
    s, u = entry.time / h, ends
    begun, ending = entry.new, u < 1
    share = jnp.where(begun, s - 0.5, 0.0) + jnp.where(ending, u - 0.5, 0.0)
    # The middle of that part of the step is not the time at which the force is evaluated.
    shift = jnp.where(begun, 0.125 - s * s / 2, 0.0) + jnp.where(ending, u * u / 2 - 0.125, 0.0)
    k = entry.response.stiffness * entry.response.impedance**2 / entry.inverse_inertia
    normal = _normal(force)
    pushing = normal > 0
    direction = force * _spread(jnp.where(pushing, 1 / jnp.where(pushing, normal, 1.0), 0.0), force)
    rate = -_spread(k * h * shift, force) * direction
    return jnp.where(_spread(begun, jump), jump / h, 0.0), _spread(share, force), rate


def _resolved(h, entry: Entry, jump) -> Bool[Array, "n"]:
    """Whether several steps pass until the force at entry has turned the rate of its row round.

    Otherwise the row leaves within a step or two, as what slides fast on MuJoCo's friction does all
    the time, and an expansion in the time since entry means nothing: errors of such entries
    multiply.
    """
    turning = h * entry.inverse_inertia * _normal(jump)
    return turning < _PART * jnp.abs(entry.velocity)


def _share_until_end(h, entry: Entry, force, change) -> Float[Array, "n"]:
    """Share of a step until the force of a row ends, 1 if it does not.

    The force is extrapolated: `df = d daref / A`, with the inverse inertia A and the impedance d.
    The change is that of the row's velocity during the step.
    """
    force, change = _normal(force), _normal(change)
    moved = h * (entry.velocity + change)
    daref = jax.vmap(Response.reference)(entry.response, change, moved)
    df = entry.response.impedance * daref / entry.inverse_inertia
    ends = (force > 0) & (force + df <= 0)
    return jnp.where(ends, force / jnp.where(ends, -df, 1.0), 1.0)


def _kept(x: Float[Array, "nv"]) -> Float[Array, "nv"]:
    """A solution that `jaxsim.checkpoint` stores."""
    return checkpoint_name(lax.stop_gradient(x), SOLUTION)


def _moved(moving: dict[int, tuple], held: tuple) -> Float[Array, "nv"]:
    """Zero; its tangent is `H^-1 J^T df`, df the sum of factors times tangents.

    Args:
      moving: for some blocks, entry times, forces and rates.
      held: operator, curvatures of H, forces that are zero, and three factors for each of these
        blocks.
    """
    leaves, structure = jax.tree.flatten((moving, held))

    def rule(primals, tangents):
        moving, held = structure.unflatten(primals)
        operator, curvatures, nothing, factors = held
        df, given = list(nothing), iter(tangents)
        for i in moving:
            for factor in factors[i]:
                tangent = next(given)
                if tangent is not None:
                    df[i] = df[i] + factor * _spread(tangent, df[i])
        change = solve_hessian(operator, curvatures, operator.pull(tuple(df)))
        return [_moved(moving, held)], [change]

    operator, _, nothing, _ = held
    force = jax.eval_shape(operator.pull, nothing)
    zero = with_jvp_rule(lambda *_: [jnp.zeros(force.shape, force.dtype)], rule)
    return zero(*leaves)[0]


def _normal(x: Array) -> Float[Array, "n"]:
    """The normal components, the first, of rows (n,) or (n, condim)."""
    return x.reshape(len(x), -1)[:, 0]


def _spread(x: Array, like: Array) -> Array:
    """An array (n,) with axes of length 1 appended, to multiply one of shape (n, ...)."""
    return x if x.shape == like.shape else x.reshape(-1, *(1,) * (like.ndim - 1))
