"""The compiled programs of a training: start, epoch, evaluation; each runs on all devices."""

import concurrent.futures
import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.sharding import Mesh

from jaxsim.envs import Env
from jaxsim.parallel.devices import AXIS, EVERYWHERE, parallel, shardings
from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.evaluation import Evaluation, evaluate
from jaxsim.rl.networks import Policy
from jaxsim.rl.parts.distributed import SPECS, Training


@dataclasses.dataclass(frozen=True)
class Programs:
    """Compiled functions.

    Attributes:
      start: `() -> Training`.
      epoch: `Training -> (Training, metrics)`; the memory of the argument is reused.
      evaluate: `learner -> Evaluation` of the deterministic policy.
      policy: `learner -> Policy`, replicated on all devices.
      copy: `Training -> Training`, in memory of its own.
    """

    start: Callable[[], Training]
    epoch: Callable[[Training], tuple[Training, dict[str, Any]]]
    evaluate: Callable[[Any], Evaluation]
    policy: Callable[[Any], Policy]
    copy: Callable[[Training], Training]


class Start:
    """The program that starts a training, traced but not compiled.

    Attributes:
      program: `() -> Training`.
      template: shapes and shardings of what it returns.
    """

    def __init__(self, algorithm: Algorithm, seed: int, mesh: Mesh):
        self.program = parallel(lambda: _start(algorithm, seed, mesh.size), mesh, (), SPECS)
        shapes = jax.eval_shape(self.program)
        self.template: Training = jax.tree.map(
            lambda x, sharding: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=sharding),
            shapes,
            _like(shapes, shardings(mesh, SPECS)),
        )


def compile_all(env: Env, algorithm: Algorithm, seed: int, mesh: Mesh, start: Start) -> Programs:
    """Trace all programs, then compile them at the same time.

    Args:
      env: environment for evaluation, without `AutoReset`.
      algorithm: the trainer.
      seed: seed of all random numbers.
      mesh: the devices.
      start: the program that starts the training.
    """
    template = start.template
    policy = parallel(algorithm.policy, mesh, (EVERYWHERE,), EVERYWHERE)
    copy = parallel(lambda training: jax.tree.map(jnp.copy, training), mesh, (SPECS,), SPECS)
    lowered = {
        "start": start.program.lower(),
        "epoch": epoch_program(algorithm, mesh).lower(template),
        "evaluate": evaluation_program(env, algorithm, seed, mesh).lower(template.learner),
        "policy": policy.lower(template.learner),
        "copy": copy.lower(template),
    }
    with concurrent.futures.ThreadPoolExecutor() as pool:
        compiled = {name: pool.submit(program.compile) for name, program in lowered.items()}
    programs: dict[str, Any] = {name: future.result() for name, future in compiled.items()}
    return Programs(**programs)


def epoch_program(algorithm: Algorithm, mesh: Mesh) -> Any:
    """The program of an epoch, not yet traced; the memory of its argument is reused."""
    epoch = lambda training: _epoch(algorithm, training)  # noqa: E731
    return parallel(epoch, mesh, (SPECS,), (SPECS, EVERYWHERE), donate=0)


def evaluation_program(env: Env, algorithm: Algorithm, seed: int, mesh: Mesh) -> Any:
    """The program of an evaluation, not yet traced; arguments as for `compile_all`."""
    judge = lambda learner: _evaluate(env, algorithm, seed, mesh.size, learner)  # noqa: E731
    return parallel(judge, mesh, (EVERYWHERE,), EVERYWHERE)


def learning_program(algorithm: Algorithm, mesh: Mesh) -> Any:
    """The program of `Algorithm.learning` alone, not yet traced."""
    learning = lambda training: algorithm.learning(training.learner, training.actors)  # noqa: E731
    return parallel(learning, mesh, (SPECS,), EVERYWHERE)


def _start(algorithm: Algorithm, seed: int, devices: int) -> Training:
    learner_key, env_key = jax.random.split(jax.random.key(seed))
    learner = algorithm.init(learner_key)
    keys = _mine(jax.random.split(env_key, algorithm.config.envs), devices)
    return Training(learner, algorithm.start(learner, keys))


def _epoch(algorithm: Algorithm, training: Training):
    learner, actors, metrics = algorithm.epoch(training.learner, training.actors)
    return Training(learner, actors), metrics


def _evaluate(env: Env, algorithm: Algorithm, seed: int, devices: int, learner) -> Evaluation:
    config = algorithm.config
    episodes = -(-config.evaluation_episodes // devices) * devices
    keys = jax.random.split(jax.random.fold_in(jax.random.key(seed), 1), episodes)
    longest = env.episode_limit or config.evaluation_steps
    result = evaluate(env, algorithm.policy(learner), _mine(keys, devices), longest)
    return lax.all_gather(result, AXIS, tiled=True)


def _mine(keys, devices: int):
    """This device's share of the keys of all environments."""
    count = keys.shape[0] // devices
    return lax.dynamic_slice_in_dim(keys, lax.axis_index(AXIS) * count, count)


def _like(training: Training, leaves: Training) -> Training:
    """One sharding for each leaf."""
    fill = lambda tree, leaf: jax.tree.map(lambda _: leaf, tree)  # noqa: E731
    return Training(fill(training.learner, leaves.learner), fill(training.actors, leaves.actors))
