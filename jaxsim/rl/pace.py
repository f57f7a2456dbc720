"""How the time of an epoch divides into simulating and learning."""

import concurrent.futures
import time
from typing import Any

import jax
from jax.sharding import Mesh

from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.parts.distributed import Training
from jaxsim.rl.programs import learning_program

# Seconds of training after which the learning part is compiled, which takes a few.
_PATIENCE = 30.0


class Pace:
    """Steps per second of simulating and of learning.

    An epoch is one program, whose parts have no times of their own. Its learning part is compiled
    once more as a program beside the training, and timed once; the rest of an epoch is simulating,
    policy included. Short trainings are not slowed down by that: they end before.
    """

    def __init__(self, algorithm: Algorithm, mesh: Mesh, template: Training):
        """Compile nothing yet.

        Args:
          algorithm: the trainer.
          mesh: the devices.
          template: shapes and shardings of the state of a training.
        """
        self._algorithm, self._mesh, self._template = algorithm, mesh, template
        self._spent = 0.0
        self._program: concurrent.futures.Future | None = None
        self._learning: float | None = None

    def compile(self) -> concurrent.futures.Future:
        """Start to compile the learning part in a thread of its own; the program is the result."""
        if self._program is None:
            lowered = learning_program(self._algorithm, self._mesh).lower(self._template)
            pool = concurrent.futures.ThreadPoolExecutor(1)
            self._program = pool.submit(lowered.compile)
            pool.shutdown(wait=False)
        return self._program

    def rates(self, training: Training, seconds: float) -> dict[str, float]:
        """Steps per second of both parts; empty until that is known, or where it cannot be.

        Args:
          training: any state of the training.
          seconds: time of the last epoch.
        """
        self._spent += seconds
        if self._spent < _PATIENCE:
            return {}
        if self._learning is None:  # the compiler may have slowed the last epoch down
            if self.compile().done():
                self._learning = _seconds(self.compile().result(), training)
            return {}
        if not 0 < self._learning < seconds:
            return {}
        parts = {"simulating": seconds - self._learning, "learning": self._learning}
        return {name: self._algorithm.steps_per_epoch / part for name, part in parts.items()}


def _seconds(program: Any, training: Training) -> float:
    """Time of a second run; zero where there is nothing to run."""
    if not jax.block_until_ready(program(training)):
        return 0.0
    start = time.perf_counter()
    jax.block_until_ready(program(training))
    return time.perf_counter() - start
