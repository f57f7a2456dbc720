"""`train`: runs a trainer on all devices, with logs, evaluations and checkpoints."""

import contextlib
import dataclasses
import importlib
import pathlib
import time
from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.sharding import Mesh

from jaxsim import envs
from jaxsim.parallel.devices import device_mesh
from jaxsim.rl import config, distributed, metrics
from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.checkpoint import CheckpointError, Checkpoints, read_run, write_run
from jaxsim.rl.distributed import Training
from jaxsim.rl.interrupts import Interrupts
from jaxsim.rl.networks import Policy
from jaxsim.rl.programs import Programs, compile_all

# Each is a module of this package, imported when it is used, with a class of the same name.
ALGORITHMS = ("ppo", "sac", "apg", "shac")


@dataclasses.dataclass(frozen=True)
class Result:
    """What a training leaves.

    Attributes:
      policy: the trained policy; `policy(obs)` is its deterministic action.
      history: one row of numbers for each epoch: "steps", "seconds" since the call of `train`
        (compilation included), "episode_return", and "eval_return" where it was evaluated.
      training: everything that training would carry on with.
      interrupted: whether a signal ended it early.
      directory: where logs and checkpoints are, if any were asked for.
    """

    policy: Policy
    history: list[metrics.Row]
    training: Training
    interrupted: bool = False
    directory: pathlib.Path | None = None

    @property
    def evaluations(self) -> list[metrics.Row]:
        """The rows with an evaluation."""
        return [row for row in self.history if "eval_return" in row]


def train(
    env: str | envs.Env,
    algorithm: str | type[Algorithm] = "ppo",
    settings: Any = None,
    *,
    overrides: Sequence[str] = (),
    seed: int = 0,
    directory: str | pathlib.Path | None = None,
    resume: bool = False,
    progress: bool = False,
    mesh: Mesh | None = None,
) -> Result:
    """Train a policy on all devices.

    An interrupt (Ctrl-C) ends training after the present epoch, with everything saved; a second
    one ends it at once.

    Args:
      env: name of an environment, or an environment (without `AutoReset`).
      algorithm: "ppo", "sac", "apg" or "shac", or a subclass of `Algorithm`.
      settings: a `Config` of the algorithm, a mapping or a YAML file with some of its fields; by
        default the tuned settings that come with jaxsim, where there are any.
      overrides: assignments such as `policy.hidden=[128,128]` on top of them.
      seed: of everything random.
      directory: where to write logs and checkpoints; nothing is written by default.
      resume: carry on from the newest checkpoint in `directory`, if there is one.
      progress: show a progress bar.
      mesh: the devices to use; all by default.

    Returns:
      The policy and how it came about.

    Raises:
      ConfigError: a setting, an environment or an algorithm does not exist or makes no sense.
      CheckpointError: the directory holds a run already, and `resume` is not set.
    """
    run = _Run(env, algorithm, resolve(env, algorithm, settings, overrides), seed, mesh)
    return run.go(None if directory is None else pathlib.Path(directory), resume, progress)


def resolve(
    env: str | envs.Env,
    algorithm: str | type[Algorithm],
    settings: Any = None,
    overrides: Sequence[str] = (),
) -> config.TrainConfig:
    """The settings of a training; arguments and errors as for `train`."""
    cls = algorithm_class(algorithm).Config
    if settings is None:
        settings = config.find(algorithm_name(algorithm), env) if isinstance(env, str) else None
        settings = {} if settings is None else settings
    if isinstance(settings, str | pathlib.Path):
        settings = config.read(pathlib.Path(settings))
    if isinstance(settings, Mapping):
        settings = config.build(cls, settings)
    if not isinstance(settings, cls):
        raise config.ConfigError(
            f"settings of {algorithm_name(algorithm)} must be a mapping, a file or a "
            f"{cls.__module__}.{cls.__qualname__}, got {settings!r}"
        )
    return config.override(settings, overrides)


def load_policy(directory: str | pathlib.Path, env: envs.Env | None = None) -> Policy:
    """The policy in the newest checkpoint of a run.

    Args:
      directory: of the run.
      env: the environment, if it was not made from a name.

    Raises:
      CheckpointError: there is no checkpoint, or nothing tells the environment.
    """
    run = read_run(directory)
    env = run_env(run) if env is None else env
    algorithm = algorithm_class(run["algorithm"])
    settings = config.build(algorithm.Config, run["settings"])
    made = algorithm(envs.AutoReset(env), settings)
    template = jax.eval_shape(lambda key: made.policy(made.init(key)), jax.random.key(0))
    here = jax.sharding.SingleDeviceSharding(jax.devices()[0])
    template = jax.tree.map(
        lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=here), template
    )
    store = Checkpoints(directory)
    try:
        return store.restore_policy(template)
    finally:
        store.close()


def run_env(run: Mapping[str, Any]) -> envs.Env:
    """The environment of a run, from what its directory says.

    Raises:
      CheckpointError: it was trained in an environment without a name.
    """
    if run["env"] is None:
        raise CheckpointError("this run was trained in an environment without a name; pass env")
    settings = config.build(algorithm_class(run["algorithm"]).Config, run["settings"])
    return make_env(run["env"], settings)


def algorithm_class(algorithm: str | type[Algorithm]) -> type[Any]:
    """The class of an algorithm; `(env, config, devices)` makes an `Algorithm`.

    Args:
      algorithm: one of `ALGORITHMS`, a class, or "module:Class".

    Raises:
      ConfigError: there is no such algorithm.
    """
    if isinstance(algorithm, type):
        return algorithm
    if algorithm in ALGORITHMS:
        return getattr(importlib.import_module(f"jaxsim.rl.{algorithm}"), algorithm.upper())
    place, colon, name = algorithm.partition(":")
    if not colon:
        raise config.ConfigError(config.unknown("algorithm", algorithm, algorithm, ALGORITHMS))
    try:
        return getattr(importlib.import_module(place), name)
    except (ImportError, AttributeError) as error:
        raise config.ConfigError(f"cannot import algorithm {algorithm!r}: {error}") from error


def algorithm_name(algorithm: str | type[Algorithm]) -> str:
    """What `algorithm_class` finds it by, from another process too."""
    if isinstance(algorithm, str):
        return algorithm
    return f"{algorithm.__module__}:{algorithm.__qualname__}"


def make_env(env: str | envs.Env, settings: config.TrainConfig) -> envs.Env:
    """The environment to evaluate in: a given one, or one of this name with the options set.

    Raises:
      ConfigError: there is no such environment, or it has no such option.
    """
    if not isinstance(env, str):
        return env
    try:
        return envs.make(env, **settings.env_options)
    except (KeyError, TypeError, ValueError) as error:
        raise config.ConfigError(error.args[0]) from error


class _Run:
    """One training: what it is about, how far it is, and where its results go."""

    def __init__(self, env, algorithm, settings: config.TrainConfig, seed: int, mesh: Mesh | None):
        self.started = time.perf_counter()
        self.mesh = device_mesh() if mesh is None else mesh
        self.settings, self.seed = settings, seed
        name = algorithm_name(algorithm)
        self.title = f"{name} on {env if isinstance(env, str) else type(env.unwrapped).__name__}"
        self.env = make_env(env, settings)
        self.algorithm: Algorithm = algorithm_class(algorithm)(
            envs.AutoReset(self.env), settings, self.mesh.size
        )
        self.record = {
            "env": env if isinstance(env, str) else None,
            "algorithm": name,
            "seed": seed,
            "settings": config.plain(settings),
        }
        self.steps = 0
        self.history: list[metrics.Row] = []

    def go(self, directory: pathlib.Path | None, resume: bool, progress: bool) -> Result:
        """Compile, train, save."""
        programs = compile_all(self.env, self.algorithm, self.seed, self.mesh)
        with contextlib.ExitStack() as stack:
            store = None
            if directory is not None:
                store = self._open(directory, resume)
                stack.callback(store.close)
            training = self._begin(programs, store)
            outputs = self._outputs(directory, progress)
            for output in outputs:
                stack.callback(output.close)
            interrupts = stack.enter_context(Interrupts())
            training = self._loop(programs, training, interrupts, store, outputs)
        policy = jax.tree.map(jnp.asarray, jax.device_get(programs.policy(training.learner)))
        return Result(policy, self.history, training, interrupts.seen, directory)

    def _loop(self, programs: Programs, training, interrupts, store, outputs) -> Training:
        done = self.steps >= self.settings.total_steps
        while not done:
            training, numbers = programs.epoch(training)
            row = {name: float(value) for name, value in numbers.items()}
            due = self._advance()
            done = interrupts.seen or self.steps >= self.settings.total_steps
            if due and not interrupts.seen:
                row |= programs.evaluate(training.learner).metrics()
                target = self.settings.target
                done |= target is not None and row["eval_return"] >= target
            row = {"steps": self.steps, "seconds": time.perf_counter() - self.started} | row
            self.history.append(row)
            for output in outputs:
                output.write(row)
            if store is not None and (due or done):
                policy = programs.policy(training.learner)
                store.save(self.steps, training, policy, {"seconds": row["seconds"]})
        return training

    def _advance(self) -> bool:
        """Count an epoch; whether an evaluation is due."""
        total, evaluations = self.settings.total_steps, self.settings.evaluations
        before, self.steps = self.steps, self.steps + self.algorithm.steps_per_epoch
        slot = lambda steps: min(steps, total) * evaluations // total  # noqa: E731
        return slot(self.steps) > slot(before)

    def _begin(self, programs: Programs, store: Checkpoints | None) -> Training:
        """The newest checkpoint, or a new training."""
        if store is None or store.latest() is None:
            return programs.start()
        training, progress = store.restore(programs.template)
        self.steps = store.latest() or 0
        self.started -= progress["seconds"]
        return training

    def _open(self, directory: pathlib.Path, resume: bool) -> Checkpoints:
        if distributed.is_main():
            write_run(directory, self.record, resume)
        return Checkpoints(directory)

    def _outputs(self, directory: pathlib.Path | None, progress: bool) -> list[Any]:
        """Where rows go; only one process writes."""
        if not distributed.is_main():
            return []
        logs = [] if directory is None else [metrics.Logs(directory)]
        bar = [metrics.Bar(self.title, self.settings.total_steps, self.steps)] if progress else []
        return logs + bar
