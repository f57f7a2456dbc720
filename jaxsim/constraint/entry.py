"""The derivative of the times at which contacts and limits begin and end to act.

In the continuous motion these times move with the state. If a row begins to act dt earlier, with an
acceleration that jumps by da, the velocity changes by `da dt` (the saltation term of hybrid
systems). Time steps do not know this: the row acts from the next step on, wherever within the step
the surfaces met. It is restored here without a change of the values.

    t = r / v          time since the row began to act: its violation r over its rate v
    s = t / h          the same as a share of the time step h, in a row's first step
    e = -r / v         time until the surfaces part, in a row's last step
    u                  share of that step for which the row acts: until its force f ends,
                       `f / -df` with its change df, or `e / h` if that is sooner

A velocity of a semi-implicit step belongs to the middle between two positions, so the force at a
step stands for half a step on either side. In the first step of a row it acts for the part
`s + 1/2` of that, in the last for `u + 1/2`. So the velocity gets, beside the derivative of the
step, that of

    H^-1 J^T (f0 t + h (s - 1/2) f)      and      H^-1 J^T (f1 e + h (u - 1/2) f)

where t, e and f have derivatives and all else is constant, f0 is the force at violation zero as a
row begins, and f1 that as the surfaces part, zero if the force has ended before.
`docs/gradients.md` has the derivation.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

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
from jaxsim.solver.operator import Rows, weighed

# An entry counts if a step changes the rate of its row by less than this part.
_PART = 0.25


@struct.dataclass
class Entry:
    """What decides when n rows begin and end to act.

    Attributes:
      new: whether the row became active within the last step.
      time: how long ago (s), zero for others.
      violation: distance minus margin; negative numbers are violations.
      velocity: rate of the violation.
      kind: cost of the rows, as if the violation of new ones were zero still.
      response: stiffness, damping and impedance.
      inverse_inertia: of the rows.
    """

    new: Bool[Array, "n"]
    time: Float[Array, "n"]
    violation: Float[Array, "n"]
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
    return Entry(
        new, time, violation, velocity, kind, response, jnp.maximum(inverse_inertia, MINVAL)
    )


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
        i: (
            entry.time,
            forces[i],
            entry.velocity + 0.5 * _normal(change[i]),
            _time_until_apart(entry, change[i]),
        )
        for i, entry in acting.items()
    }
    held = lax.stop_gradient((acting, list(kinds), forces, operator, h, change))
    acting, kinds, forces, operator, h, change = held
    force_changes = _force_changes(h, acting, kinds, operator, change)
    apart = {i: times[3] / h for i, times in lax.stop_gradient(moving).items()}
    problem = Problem(tuple(acting[i].kind if i in acting else k for i, k in enumerate(kinds)))
    first = operator.rows(operator.lift(_kept(minimised(problem))))
    jumps, curvatures = problem.forces(first), list(problem.curvatures(first))
    factors = {}
    for i, entry in acting.items():
        entry = entry.replace(new=entry.new & _resolved(h, entry, jumps[i], entry.velocity))
        last = _last_step(h, entry, forces[i], force_changes[i], change[i], apart[i])
        ends = last.share
        factors[i] = _factors(h, entry, jumps[i], forces[i], last)
        switches = _spread(entry.new | (ends < 1), curvatures[i])
        curvatures[i] = jnp.where(switches, 0.0, curvatures[i])
    nothing = tuple(jnp.zeros_like(f) for f in forces)
    return _moved(moving, (operator, tuple(curvatures), nothing, factors))


class LastStep(NamedTuple):
    """How the rows of a block end to act within a step.

    Attributes:
      share: of the step for which they act; 1 if they do not end.
      force: what they are at their end; zero if it is that what ends them.
    """

    share: Float[Array, "n"]
    force: Array


def _factors(h, entry: Entry, jump, force, last: LastStep) -> tuple[Array, Array, Array, Array]:
    """Factors of the tangents of what moves in a block in its extra force.

    That are entry times, forces, rates and the times until the surfaces are apart.
    """
    s, u = entry.time / h, last.share
    begun, ending = entry.new, u < 1
    share = jnp.where(begun, s - 0.5, 0.0) + jnp.where(ending, u - 0.5, 0.0)
    # The middle of that part of the step is not the time at which the force is evaluated.
    shift = jnp.where(begun, 0.125 - s * s / 2, 0.0) + jnp.where(ending, u * u / 2 - 0.125, 0.0)
    k = entry.response.stiffness * entry.response.impedance**2 / entry.inverse_inertia
    normal = _normal(force)
    pushing = normal > 0
    direction = force * _spread(jnp.where(pushing, 1 / jnp.where(pushing, normal, 1.0), 0.0), force)
    rate = -_spread(k * h * shift, force) * direction
    return (
        jnp.where(_spread(begun, jump), jump / h, 0.0),
        _spread(share, force),
        rate,
        last.force / h,
    )


def _resolved(h, entry: Entry, jump, velocity) -> Bool[Array, "n"]:
    """Whether it takes several steps until a force that jumps has turned the rate of its row round.

    Otherwise the row leaves within a step or two, as what slides fast on MuJoCo's friction does all
    the time, and an expansion in the time since entry means nothing: errors of such entries
    multiply.
    """
    turning = h * entry.inverse_inertia * _normal(jump)
    return turning < _PART * jnp.abs(velocity)


def _force_changes(h, acting: dict[int, Entry], kinds, operator: Operator, change) -> Rows:
    """Changes of all forces during the step, to first order.

    References change by `daref = -b dv - k d dr` as violations and their rates do, so the
    acceleration changes by `da = H^-1 J^T W daref`, and forces by `df = W (daref - J da)`. So the
    force of a row that is coupled with others, such as a normal force with friction, changes as
    they do.

    Args:
      h: time step.
      acting: what decides when rows act, by their block.
      kinds: cost of each block.
      operator: mass matrix and Jacobian of the blocks.
      change: of the velocities of the rows during the step, `h J x`.
    """
    curvatures = Problem(tuple(kinds)).curvatures(tuple(rows / h for rows in change))
    references = [jnp.zeros_like(rows) for rows in change]
    for i, entry in acting.items():
        references[i] = _reference_change(h, entry, change[i])
    pushed = tuple(
        weighed(W, r[..., None])[..., 0] for W, r in zip(curvatures, references, strict=True)
    )
    da = solve_hessian(operator, tuple(curvatures), operator.pull(pushed))
    moved = operator.rows(operator.lift(da))
    return tuple(
        f - weighed(W, r[..., None])[..., 0]
        for f, W, r in zip(pushed, curvatures, moved, strict=True)
    )


def _reference_change(h, entry: Entry, change) -> Array:
    """Change of the reference accelerations of a block's rows; friction has dampers only."""
    moved = h * (entry.velocity + _normal(change))
    spring = entry.response.stiffness * entry.response.impedance * moved
    damper = _spread(entry.response.damping, change) * change
    normal = jnp.zeros_like(change).reshape(len(change), -1).at[:, 0].set(spring)
    return -damper - normal.reshape(change.shape)


def _time_until_apart(entry: Entry, change) -> Float[Array, "n"]:
    """Time until a violation is zero at the velocity of the step's end; infinite if it grows."""
    velocity = entry.velocity + _normal(change)
    leaves = (entry.violation < 0) & (velocity > 0)
    return jnp.where(leaves, -entry.violation / jnp.where(leaves, velocity, 1.0), jnp.inf)


def _last_step(h, entry: Entry, force, force_change, change, apart) -> LastStep:
    """The end of the rows of a block: where their force is zero, or where the surfaces part.

    Args:
      h: time step.
      entry: what decides when the rows act.
      force: now.
      force_change: of the force during the step.
      change: of the velocities of the rows.
      apart: time until the surfaces part, in steps.
    """
    f, df = _normal(force), _normal(force_change)
    leaving = entry.velocity + _normal(change)
    fades = (f > 0) & (f + df <= 0)
    fade = jnp.where(fades, f / jnp.where(fades, -df, 1.0), 1.0)
    parts = (f > 0) & (apart < fade)
    left = force + _spread(jnp.where(parts, apart, 0.0), force) * force_change
    parts = parts & _resolved(h, entry, force, leaving)
    return LastStep(jnp.where(parts, apart, fade), jnp.where(_spread(parts, force), left, 0.0))


def _kept(x: Float[Array, "nv"]) -> Float[Array, "nv"]:
    """A solution that `jaxsim.checkpoint` stores."""
    return checkpoint_name(lax.stop_gradient(x), SOLUTION)


def _moved(moving: dict[int, tuple], held: tuple) -> Float[Array, "nv"]:
    """Zero; its tangent is `H^-1 J^T df`, df the sum of factors times tangents.

    Args:
      moving: for some blocks, entry times, forces, rates and times until the surfaces are apart.
      held: operator, curvatures of H, forces that are zero, and four factors for each of these
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
