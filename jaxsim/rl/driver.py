"""`train`: runs a trainer on all devices, with logs, evaluations and checkpoints."""

import contextlib
import dataclasses
import functools
import math
import pathlib
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.sharding import Mesh

from jaxsim import envs
from jaxsim.parallel.devices import device_mesh
from jaxsim.rl import config, metrics
from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.bar import Bar
from jaxsim.rl.checkpoint import KEPT, Checkpoints
from jaxsim.rl.evaluation import Evaluation
from jaxsim.rl.lookup import ALGORITHMS, algorithm_class, algorithm_name, make_env
from jaxsim.rl.networks import Policy
from jaxsim.rl.pace import Pace
from jaxsim.rl.parts import distributed
from jaxsim.rl.parts.distributed import Training
from jaxsim.rl.programs import Programs, Start, compile_all
from jaxsim.rl.runs import directory
from jaxsim.rl.runs.interrupts import Interrupts
from jaxsim.rl.runs.stored import load_policy, run_env
from jaxsim.rl.values import Seed, fit

__all__ = [
    "ALGORITHMS",
    "Result",
    "algorithm_class",
    "algorithm_name",
    "load_policy",
    "make_env",
    "resolve",
    "run_env",
    "train",
]


@dataclasses.dataclass(frozen=True)
class Result:
    """The result of a training.

    Attributes:
      policy: the trained policy; `policy(obs)` is its deterministic action.
      history: one row of numbers for each epoch: "steps", "seconds" since the call of `train`
        (with compilation), "episode_return", and "eval_return" if it was evaluated.
      training: the state from which training could continue.
      interrupted: whether a signal ended it early.
      finished: whether the resumed run had already ended, so that nothing was done.
      directory: directory of logs and checkpoints; None if nothing was written.
    """

    policy: Policy
    history: list[metrics.Row]
    training: Training
    interrupted: bool = False
    finished: bool = False
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
    watch: Callable[[Policy], None] | None = None,
) -> Result:
    """Train a policy on all devices.

    An interrupt (Ctrl-C) ends training after the epochs that have been started, two at most, with a
    checkpoint; a second one ends it at once.

    Args:
      env: name of an environment, "module:Class", or an environment (without `AutoReset`).
      algorithm: "ppo", "sac", "apg" or "shac", a subclass of `Algorithm`, or "module:Class".
      settings: a `Config` of the algorithm, a mapping or a YAML file with some of its fields; by
        default the tuned settings that come with jaxsim, where there are any.
      overrides: assignments such as `policy.hidden=[128,128]` on top of them.
      seed: seed of all random numbers.
      directory: directory for logs and checkpoints; None to write nothing.
      resume: whether to continue from the newest checkpoint in `directory`, if there is one.
      progress: whether to show a progress bar.
      mesh: the devices to use; all by default.
      watch: called with the policy after each epoch, while the next one runs.

    Returns:
      The policy and the history of the training.

    Raises:
      ConfigError: a setting, an environment or an algorithm is unknown or invalid.
      CheckpointError: the directory cannot be written to, is in use, or already contains a run
        while `resume` is false; or the run to resume is damaged, or a different one.
    """
    run = _Run(env, algorithm, resolve(env, algorithm, settings, overrides), seed, mesh)
    run.watch = watch
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
        tuned = config.find(algorithm_name(algorithm), env) if isinstance(env, str) else None
        settings = {} if tuned is None else config.read(tuned)
    if isinstance(settings, str | pathlib.Path):
        settings = config.read(pathlib.Path(settings))
    if isinstance(settings, Mapping):
        settings = config.build(cls, config.for_device(settings, jax.default_backend()))
    if not isinstance(settings, cls):
        raise config.ConfigError(
            f"settings of {algorithm_name(algorithm)} must be a mapping, a file or a "
            f"{cls.__module__}.{cls.__qualname__}, got {settings!r}"
        )
    return config.override(settings, overrides)


@dataclasses.dataclass(frozen=True)
class _Epoch:
    """An epoch that has been started; the numbers are on the device, not yet waited for.

    Attributes:
      steps: environment steps of the training up to its end.
      begun: when it was started.
      numbers: what it logs.
      watched: the policy after it, if somebody watches.
      stored: copies of the training and the policy after it, if a checkpoint was due.
      evaluation: of the policy after it, if one was due.
    """

    steps: int
    begun: float
    numbers: dict[str, Any]
    watched: Policy | None
    stored: tuple[Training, Policy] | None
    evaluation: Evaluation | None


class _Run:
    """One training: its settings, its progress and its outputs."""

    def __init__(self, env, algorithm, settings: config.TrainConfig, seed: int, mesh: Mesh | None):
        self.started = time.perf_counter()
        self.mesh = device_mesh() if mesh is None else mesh
        self.settings, self.seed = settings, fit(Seed, seed, "seed")
        name = algorithm_name(algorithm)
        self.env = make_env(env, settings)
        self.title = f"{name} on {env if isinstance(env, str) else type(env.unwrapped).__name__}"
        self.algorithm: Algorithm = algorithm_class(algorithm)(
            envs.AutoReset(self.env), settings, self.mesh.size
        )
        self.record = {
            "env": env if isinstance(env, str) else None,
            "algorithm": name,
            "seed": self.seed,
            "settings": config.plain(settings),
        }
        self.steps = 0
        self.history: list[metrics.Row] = []
        self.watch: Callable[[Policy], None] | None = None
        self.timed: Callable[[Training, float], None] | None = None
        self.free = 0.0  # when the device had done all that was waited for

    def go(self, folder: pathlib.Path | None, resume: bool, progress: bool) -> Result:
        """Open the directory, compile, train, save."""
        with contextlib.ExitStack() as stack:
            bar = self._bar(stack, progress)
            store = self._open(stack, folder, resume)
            start = Start(self.algorithm, self.seed, self.mesh)
            training, finished = self._restore(store, start.template)
            if finished:
                return self._result(training, folder, finished=True)
            if store is not None:
                self._record(store, start.template)
            programs = compile_all(self.env, self.algorithm, self.seed, self.mesh, start)
            outputs: list[Any] = self._logs(stack, folder)
            if bar is not None:
                outputs.append(bar)
                bar.training(self.settings.total_steps, self.steps)
                self._show_pace(bar, start.template)
            training = programs.start() if training is None else training
            interrupts = stack.enter_context(Interrupts())
            training = self._loop(programs, training, interrupts, store, outputs)
            if bar is not None and not interrupts.seen:
                bar.finish()
        return self._result(training, folder, interrupted=interrupts.seen)

    def _show_pace(self, bar: Bar, template: Training) -> None:
        """Have the bar say steps per second of simulating and of learning, once.

        Not with several processes, of which all or none would have to run the program.
        """
        if jax.process_count() == 1:
            pace = Pace(self.algorithm, self.mesh, template)

            def timed(training: Training, seconds: float) -> None:
                rates = pace.rates(training, seconds)
                if rates:
                    bar.pace(rates)
                    self.timed = None

            self.timed = timed

    def _bar(self, stack: contextlib.ExitStack, progress: bool) -> Bar | None:
        if not (progress and distributed.is_main()):
            return None
        bar = Bar(self.title)
        stack.callback(bar.close)
        bar.compiling()
        return bar

    def _open(self, stack, folder: pathlib.Path | None, resume: bool) -> Checkpoints | None:
        """Open the checkpoints in the directory and lock it until the end."""
        if folder is None:
            return None
        if distributed.is_main():
            stack.enter_context(directory.hold(folder, resume))
            directory.check_same(folder, self.record)
        store = Checkpoints(folder)
        stack.callback(store.close)
        return store

    def _restore(self, store: Checkpoints | None, template: Training) -> tuple[Any, bool]:
        """The newest stored training, or None, and whether it has already ended."""
        if store is None or store.latest() is None:
            return None, False
        self.steps, training, progress = store.restore(template)
        self.started -= progress["seconds"]
        target = self.settings.target
        reached = target is not None and progress.get("eval_return", -math.inf) >= target
        return training, reached or self.steps >= self.settings.total_steps

    def _record(self, store: Checkpoints, template: Training) -> None:
        """Write "run.yaml", after checking that there is space for the checkpoints."""
        if distributed.is_main():
            missing = KEPT + 1 - min(KEPT, len(store.steps()))
            size = sum(x.size * x.dtype.itemsize for x in jax.tree.leaves(template))
            directory.check_space(store.directory, missing * (size + 1_000_000))
            directory.write_run(store.directory, self.record)

    def _logs(self, stack, folder: pathlib.Path | None) -> list[Any]:
        """The logs; only one process writes them."""
        if folder is None or not distributed.is_main():
            return []
        with directory.writing(folder):
            logs = metrics.Logs(folder, self.steps)
        stack.callback(logs.close)
        return [logs]

    def _loop(self, programs: Programs, training, interrupts, store, outputs) -> Training:
        """Start each epoch before the one before it, and its evaluation, are waited for.

        So the device never waits for the host: what an epoch found is read, logged and stored while
        the next one runs. Only where there is a target, which may end the training, is an
        evaluation read at once.
        """
        end = functools.partial(self._end, store, outputs)
        target, last, done = self.settings.target, None, False
        while not done:
            training, epoch = self._begin(programs, training, store)
            if last is not None:
                end(last, training)
            last = epoch
            done = interrupts.seen or self.steps >= self.settings.total_steps
            if epoch.evaluation is not None and target is not None:
                done |= end(epoch, training)["eval_return"] >= target
                last = None
        if last is not None:
            now = training, programs.policy(training.learner)
            end(dataclasses.replace(last, stored=now), training)
        return training

    def _begin(self, programs: Programs, training, store) -> tuple[Training, _Epoch]:
        """Start an epoch, and what is due after it, of which the next epoch would leave nothing."""
        begun = time.perf_counter()
        training, numbers = programs.epoch(training)
        due, policy = self._advance(), lambda: programs.policy(training.learner)
        stores = due and store is not None
        return training, _Epoch(
            steps=self.steps,
            begun=begun,
            numbers=numbers,
            watched=policy() if self.watch is not None else None,
            stored=(programs.copy(training), policy()) if stores else None,
            evaluation=programs.evaluate(training.learner) if due else None,
        )

    def _end(self, store, outputs, epoch: _Epoch, training) -> metrics.Row:
        """Wait for an epoch, log it, store what is due; `training` is the newest state.

        Nothing is computed on the device for it, which would come after the epoch that runs there.
        """
        row = {name: float(x) for name, x in jax.device_get(epoch.numbers).items()}
        seconds = time.perf_counter() - max(epoch.begun, self.free)
        if epoch.evaluation is not None:
            row |= epoch.evaluation.metrics()
        self.free = time.perf_counter()
        row = {"steps": epoch.steps, "seconds": self.free - self.started} | row
        if self.watch is not None and epoch.watched is not None:
            self.watch(epoch.watched)
        self._write(row, store, outputs)
        if store is not None and epoch.stored is not None:
            kept = {name: row[name] for name in ("seconds", "eval_return") if name in row}
            store.save(epoch.steps, *epoch.stored, kept)
        if self.timed is not None:
            self.timed(training, seconds)
            self.free = time.perf_counter()
        return row

    def _write(self, row: metrics.Row, store: Checkpoints | None, outputs) -> None:
        self.history.append(row)
        with contextlib.nullcontext() if store is None else directory.writing(store.directory):
            for output in outputs:
                output.write(row)

    def _advance(self) -> bool:
        """Count an epoch; return whether an evaluation is due."""
        total, evaluations = self.settings.total_steps, self.settings.evaluations
        before, self.steps = self.steps, self.steps + self.algorithm.steps_per_epoch
        slot = lambda steps: min(steps, total) * evaluations // total  # noqa: E731
        return slot(self.steps) > slot(before)

    def _result(self, training: Training, folder: pathlib.Path | None, **how: bool) -> Result:
        policy = jax.device_get(self.algorithm.policy(training.learner))
        return Result(
            jax.tree.map(jnp.asarray, policy), self.history, training, directory=folder, **how
        )
