"""`fit`: parameters of a model from recorded trajectories."""

import dataclasses
import functools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
import optax
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.precision import full_precision
from jaxsim.batching import vmap
from jaxsim.model import Model
from jaxsim.model.inputs import admit_model
from jaxsim.solver.levenberg_marquardt import Iterate, begin, minimise
from jaxsim.sysid.confidence import Combination, covariance, undetermined
from jaxsim.sysid.errors import SysidError
from jaxsim.sysid.multiple_shooting import Fitting, Point, information
from jaxsim.sysid.parameters import Parameter, ParameterSet
from jaxsim.sysid.prediction import Noise
from jaxsim.sysid.recording import Recording, Windows, admit_recordings, cut

_TOLERANCE = 1e-6  # relative decrease of the cost below which a fit is over
_STILL = 1e-3  # the same for the last cost of a descent above the least


@dataclasses.dataclass(frozen=True)
class Fit:
    """Result of an identification.

    Attributes:
      model: the model with the fitted numbers.
      names: (p,) what was fitted.
      values: (p,) the numbers; coordinates for `inertia[...]`.
      std: (p,) their standard deviations, relative for numbers whose logarithm was fitted. They
        count on the noise that was given, or on what was found if that is larger.
      covariance: (p, p) of the coordinates: logarithms or numbers.
      undetermined: combinations of parameters that the data leave open.
      misfit: root mean square of the residual in standard deviations of the noise; about one if
        model and noise are right.
      converged: whether the best start came to an end.
      iterations: evaluations of the best start, in the last stage.
      costs: (starts,) where each start ended; the best one is reported.
      coordinates: (starts, p) the coordinates where each start ended.
      windows: the data of the last stage.
      predicted_qpos: (W, L, nq) what the fitted model says about them.
      predicted_qvel: (W, L, nv) the same for velocities.
    """

    model: Model
    names: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray
    covariance: np.ndarray
    undetermined: list[Combination]
    misfit: float
    converged: bool
    iterations: int
    costs: np.ndarray
    coordinates: np.ndarray
    windows: Windows
    predicted_qpos: np.ndarray
    predicted_qvel: np.ndarray

    def __str__(self) -> str:
        """A table of the numbers, and what is not determined."""
        lines = [
            f"{name:40s} {value:12.6g}  +- {std:.2g}"
            for name, value, std in zip(self.names, self.values, self.std, strict=True)
        ]
        lines += [f"not determined: {c.text}" for c in self.undetermined]
        state = "converged" if self.converged else "did not converge"
        return "\n".join([*lines, f"misfit {self.misfit:.3g} sigma, {state}"])


@full_precision
def fit(
    model: Model,
    data: Recording | Sequence[Recording],
    parameters: Sequence[Parameter | str],
    *,
    window: int | Sequence[int | None] | None = 25,
    noise: tuple[float | np.ndarray, float | np.ndarray] = (1e-3, 1e-2),
    starts: int = 1,
    iterations: int = 50,
    substeps: int = 1,
    refine: bool = True,
    huber: float = 5.0,
    method: str | optax.GradientTransformation = "lm",
    seed: int = 0,
) -> Fit:
    """Numbers of a model that explain recorded trajectories best.

    The recordings are cut into windows, and each window is predicted from a first state of its own,
    which is fitted along with the parameters (multiple shooting). Short windows make a smooth
    problem, long ones an exact one: after contact, a rollout depends on its parameters in leaps. A
    sequence of window lengths goes from one to the other. The cost is

        sum rho((predicted - measured) / noise) + 1/2 sum |(x - center) / prior|^2

    with Huber's rho, which is `r^2 / 2` for small residuals.

    Use float64 (`jax_enable_x64`) for more than a handful of parameters, and a solver that
    converges (`model.opt.iterations`): derivatives are those of the exact minimum.

    Args:
      model: the model before identification.
      data: recordings, one or several, sampled every `substeps` time steps of the model.
      parameters: what to fit: names, see `Parameter`.
      window: samples of a window, None for all of the shortest recording; several for stages, each
        of which begins where the one before ended.
      noise: standard deviations of measured coordinates and velocities, for all or for each degree
        of freedom.
      starts: number of first guesses that are fitted at once; the first is the model's.
      iterations: largest number of evaluations in each stage.
      substeps: time steps between two samples.
      refine: whether first states are fitted; otherwise they are those measured.
      huber: residual in standard deviations beyond which the cost grows linearly, so that windows
        in which a contact is missed do not outweigh the others.
      method: "lm" for Levenberg-Marquardt, or a transformation of optax.
      seed: of the other first guesses.

    Returns:
      The best of all starts, with its confidence.

    Raises:
      SysidError: a parameter or the data make no sense; the message says which.
    """
    model = admit_model(model)
    parameters = [parameters] if isinstance(parameters, str | Parameter) else parameters
    chosen = ParameterSet(model, parameters)
    recordings = admit_recordings(model, data)
    _check_counts(starts=starts, iterations=iterations, substeps=substeps)
    lengths = window if isinstance(window, Sequence) else [window]
    interval = substeps * float(model.opt.timestep)
    x = _first_guesses(chosen, starts, seed)
    for length in lengths:
        windows = cut(model, recordings, length, interval)
        problem = _fitting(chosen, windows, _noise(model, noise), substeps, refine, huber)
        ends = _run(problem, x, iterations, method)
        x = ends.x.x
    return _result(chosen, problem, ends)


def _check_counts(**counts: int) -> None:
    for name, value in counts.items():
        if not isinstance(value, int) or value < 1:
            raise SysidError(f"{name} must be a positive integer, got {value!r}")


def _noise(model: Model, noise) -> Noise:
    arrays = [np.broadcast_to(np.asarray(n, float), (model.nv,)) for n in noise]
    if not all((a > 0).all() for a in arrays):
        raise SysidError("noise must be positive standard deviations")
    return Noise(*(jnp.asarray(a, model.qpos0.dtype) for a in arrays))


def _first_guesses(chosen: ParameterSet, starts: int, seed: int) -> Float[Array, "starts p"]:
    start, spread = chosen.stacked("start"), chosen.stacked("spread") * chosen.stacked("scale")
    chance = np.random.default_rng(seed).standard_normal((starts, len(start)))
    chance[0] = 0
    return start[None] + spread[None] * jnp.asarray(chance, start.dtype)


def _fitting(
    chosen, windows: Windows, noise: Noise, substeps: int, refine: bool, huber: float
) -> Fitting:
    prior = chosen.stacked("prior") * chosen.stacked("scale")
    return Fitting(
        model=chosen.model,
        windows=windows,
        noise=noise,
        substeps=substeps,
        center=chosen.stacked("center"),
        precision=1 / prior**2,
        scale=chosen.stacked("scale"),
        refine=refine,
        huber=huber,
    )


def _run(problem: Fitting, x: Float[Array, "starts p"], iterations: int, method) -> Iterate:
    """Where all starts end."""
    if not (method == "lm" or isinstance(method, optax.GradientTransformation)):
        raise SysidError(f"method must be 'lm' or a transformation of optax, got {method!r}")
    count, size = problem.windows.weight.shape[0], 2 * problem.noise.pos.shape[0]

    def one(x, windows):
        here = problem._replace(windows=windows)
        point = Point(x, jnp.zeros((count, size), x.dtype))
        if method == "lm":
            squares = here.least_squares()
            return minimise(squares, point, iterations=iterations, tolerance=_TOLERANCE)
        return _descend(here, point, iterations, method)

    if len(x) == 1:
        return jax.tree.map(lambda a: a[None], jax.jit(one)(x[0], problem.windows))
    return jax.jit(vmap(one, (0, None)))(x, problem.windows)


def _descend(problem: Fitting, point: Point, iterations: int, method) -> Iterate:
    """The best point of a descent by gradients."""

    def body(carry, _):
        point, memory, best, least = carry
        cost, gradient = jax.value_and_grad(problem.cost)(point)
        if not problem.refine:
            gradient = gradient._replace(starts=jnp.zeros_like(gradient.starts))
        better = cost < least
        best = jax.tree.map(functools.partial(jnp.where, better), point, best)
        update, memory = method.update(gradient, memory, point)
        return (optax.apply_updates(point, update), memory, best, jnp.minimum(cost, least)), cost

    inf = jnp.asarray(jnp.inf, point.x.dtype)
    (_, _, best, least), costs = lax.scan(
        body, (point, method.init(point), point, inf), None, length=iterations
    )
    end = begin(problem.least_squares(), best)
    _, found = problem.evaluate(best)
    still = jnp.abs(costs[-1] - least) <= _STILL * least
    return end.replace(cost=least, normal=found, count=end.count + iterations, converged=still)


def _result(chosen: ParameterSet, problem: Fitting, ends: Iterate) -> Fit:
    """The report on the best of all ends."""
    costs = np.asarray(ends.cost)
    best = int(np.argmin(np.where(np.isfinite(costs), costs, np.inf)))
    end = jax.tree.map(lambda a: a[best], ends)
    model, known = jax.jit(lambda e: (chosen.model(e.x.x), information(e.normal.normal)))(end)
    misfit = _misfit(problem, end)
    scale = np.asarray(chosen.stacked("scale"), float)
    precision = np.diag(np.asarray(problem.precision, float))
    # A model that explains the data worse than their noise is trusted less.
    data = (np.asarray(known, float) - precision) / max(misfit, 1.0) ** 2
    spread = covariance(data + precision, scale)
    return Fit(
        model=_with_numbers(chosen.base, model),
        names=chosen.labels,
        values=np.asarray(chosen.values(end.x.x)),
        std=np.sqrt(np.diagonal(spread)),
        covariance=spread,
        undetermined=undetermined(data, scale, chosen.labels),
        misfit=misfit,
        converged=bool(end.converged),
        iterations=int(end.count),
        costs=costs,
        coordinates=np.asarray(ends.x.x),
        windows=problem.windows,
        predicted_qpos=np.asarray(end.normal.qpos),
        predicted_qvel=np.asarray(end.normal.qvel),
    )


def _misfit(problem: Fitting, end: Iterate) -> float:
    """Root mean square of the residual, for each number that is measured and not used up."""
    windows, nv = problem.windows, problem.noise.pos.shape[0]
    measured = nv * float((windows.weight.sum(1) * (1 + windows.has_qvel)).sum())
    unknown = len(end.x.x) + (end.x.starts.size if problem.refine else 0)
    return float(np.sqrt(2 * float(end.cost) / max(measured - unknown, 1.0)))


def _with_numbers(base: Model, found: Model) -> Model:
    """The base with all numbers of another model; which forces it has follows from them."""
    fields = [f.name for f in dataclasses.fields(base) if f.metadata.get("pytree_node", True)]
    return base.replace(**{name: getattr(found, name) for name in fields})
