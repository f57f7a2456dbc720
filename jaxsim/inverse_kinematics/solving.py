"""`ik`: Levenberg-Marquardt in the tangent space of the coordinates, with restarts."""

from collections.abc import Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float, Int

from jaxsim.arrays.precision import full_precision
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.inverse_kinematics.box import Box, clamped
from jaxsim.inverse_kinematics.target import PoseTarget, admit_target, miss
from jaxsim.joints.coordinates import difference_pos
from jaxsim.model import Model
from jaxsim.model.inputs import admit_array, admit_model
from jaxsim.solver.levenberg_marquardt import (
    Iterate,
    LeastSquares,
    advance,
    begin,
    damped_step,
    restart,
)

_TOLERANCE = 1e-3  # relative decrease of the cost, below which a start is given up
_PATIENCE = 20  # steps from one start


@struct.dataclass
class IkResult:
    """Coordinates, and how near to the targets they bring everything.

    Attributes:
      qpos: the coordinates.
      reached: whether every target is met within the tolerances.
      pos_error: largest distance from a target position (m).
      rot_error: largest angle from a target orientation (rad).
      iterations: steps taken, from all starts together.
      restarts: how often the search began anew.
    """

    qpos: Float[Array, "nq"]
    reached: Bool[Array, ""]
    pos_error: Float[Array, ""]
    rot_error: Float[Array, ""]
    iterations: Int[Array, ""]
    restarts: Int[Array, ""]


class _Normal(NamedTuple):
    """What is known at a point: normal equations, and errors."""

    H: Float[Array, "nv nv"]
    g: Float[Array, "nv"]
    free: Bool[Array, "nv"]
    pos_error: Float[Array, ""]
    rot_error: Float[Array, ""]


class _Search(NamedTuple):
    now: Iterate
    best: IkResult
    best_cost: Float[Array, ""]
    begun: Int[Array, ""]  # step at which this start began


@full_precision
def ik(
    model: Model,
    targets: Sequence[PoseTarget] | PoseTarget,
    start: Float[Array, "nq"] | None = None,
    *,
    joints: Sequence[str] | None = None,
    posture: Float[Array, "nq"] | None = None,
    posture_weight: float = 0.01,
    iterations: int = 200,
    pos_tolerance: float = 1e-4,
    rot_tolerance: float = 1e-3,
) -> IkResult:
    """Coordinates at which sites and bodies are at their targets, within the joints' limits.

    Minimises `1/2 sum |w e|^2` over the targets' position and orientation errors e, and the
    distance from a posture, by Levenberg-Marquardt. Joints at a limit stay there while the cost
    pushes them outwards. A search that ends away from the targets begins anew elsewhere within the
    limits. It is a pure function of one problem: `jaxsim.vmap` makes a batch of it.

    Example:
      >>> reach = lambda pos: jaxsim.ik(model, jaxsim.PoseTarget(site="hand", pos=pos))
      >>> found = jax.jit(jaxsim.vmap(reach))(points)

    Args:
      model: the model.
      targets: one target, or several to be met together.
      start: where the search begins, `qpos0` if it is None.
      joints: names of the joints that may move, all if it is None.
      posture: coordinates to stay near where the targets leave a choice; a small error at the
        targets, of the order of the square of `posture_weight`, is the price.
      posture_weight: of the distance from the posture.
      iterations: largest number of steps, of all starts together.
      pos_tolerance: distance at which a position counts as reached (m).
      rot_tolerance: angle at which an orientation counts as reached (rad).

    Returns:
      The coordinates and how near they are: of all that was found the first that reaches the
      targets or, if none does, that of the least cost.

    Raises:
      TypeError: an argument is of the wrong type.
      ValueError: a target wants nothing, names nothing, or an array has the wrong shape.
      KeyError: the model has no element with a name that is given.
    """
    model = admit_model(model)
    targets = [targets] if isinstance(targets, PoseTarget) else list(targets)
    if not targets:
        raise ValueError("ik needs at least one target")
    targets = [admit_target(model, t) for t in targets]
    start = model.qpos0 if start is None else admit_array(model, start, (model.nq,), "start")
    if posture is not None:
        posture = admit_array(model, posture, (model.nq,), "posture")
    box = Box.of(model, joints)
    problem = _problem(model, targets, box, posture, posture_weight)
    search = _start(problem, clamped(model, start))
    again = lambda count: box.sample(model, start, count)  # noqa: E731
    return lax.while_loop(
        lambda s: (s.now.count < iterations) & ~(s.best.reached & _settled(s, posture is None)),
        lambda s: _advance(problem, again, (pos_tolerance, rot_tolerance), s),
        search,
    ).best


def _start(problem: LeastSquares, x: Float[Array, "nq"]) -> _Search:
    now = begin(problem, x)
    zero, inf = jnp.zeros((), jnp.int32), now.cost
    return _Search(now, IkResult(x, jnp.zeros((), bool), inf, inf, zero, zero), inf, zero)


def _settled(s: _Search, at_once: bool) -> Bool[Array, ""]:
    """Whether a point that reaches the targets is good enough: any, or one at rest."""
    return jnp.ones((), bool) if at_once else s.now.done


def _advance(problem: LeastSquares, again, tolerances, s: _Search) -> _Search:
    """One step, or one new start, which costs the same evaluation."""
    over = (s.now.done | (s.now.count - s.begun >= _PATIENCE)) & ~s.best.reached
    elsewhere = restart(s.now, again(s.now.count))
    now = jax.tree.map(lambda a, b: jnp.where(over, a, b), elsewhere, s.now)
    now = advance(problem, now, _TOLERANCE)
    found = _result(now, tolerances, s.best.restarts + over)
    better = (now.cost < s.best_cost) & (found.reached | ~s.best.reached)
    better = better | (found.reached & ~s.best.reached)
    best = jax.tree.map(lambda a, b: jnp.where(better, a, b), found, s.best)
    best = best.replace(iterations=found.iterations, restarts=found.restarts)
    return _Search(
        now,
        best,
        jnp.where(better, now.cost, s.best_cost),
        jnp.where(over, s.now.count, s.begun),
    )


def _result(now: Iterate, tolerances, restarts) -> IkResult:
    errors = now.normal.pos_error, now.normal.rot_error
    reached = (errors[0] <= tolerances[0]) & (errors[1] <= tolerances[1])
    return IkResult(now.x, reached, *errors, iterations=now.count, restarts=restarts)


def _problem(model: Model, targets, box: Box, posture, posture_weight) -> LeastSquares:
    """The sum of squares as a function of the coordinates."""

    def evaluate(qpos):
        kin = kinematics(model, qpos)
        misses = [miss(model, kin, target) for target in targets]
        r = jnp.concatenate([m.residual for m in misses])
        J = jnp.concatenate([m.jacobian for m in misses])
        H, g, cost = J.T @ J, J.T @ r, 0.5 * r @ r
        if posture is not None:
            away = difference_pos(model, posture, qpos)
            H = H + posture_weight**2 * jnp.eye(model.nv, dtype=H.dtype)
            g, cost = g + posture_weight**2 * away, cost + 0.5 * posture_weight**2 * away @ away
        distance = jnp.stack([m.distance for m in misses]).max()
        angle = jnp.stack([m.angle for m in misses]).max()
        return cost, _Normal(H, g, box.free(qpos, g), distance, angle)

    def solve(normal, damping):
        free = normal.free
        both = free[:, None] & free[None, :]
        H = jnp.where(both, normal.H, 0.0) + jnp.diag(jnp.where(free, 0.0, 1.0))
        return damped_step(H, jnp.where(free, normal.g, 0.0), damping)

    return LeastSquares(evaluate, solve, lambda qpos, step: box.move(model, qpos, step))
