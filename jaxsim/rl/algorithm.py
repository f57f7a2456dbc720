"""`Algorithm`: the interface of trainers, functions for one device."""

import abc
from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.envs import Env
from jaxsim.parallel.devices import AXIS
from jaxsim.rl.config import TrainConfig
from jaxsim.rl.errors import ConfigError
from jaxsim.rl.networks import ActionRange, Policy
from jaxsim.rl.normalize import RunningStatistics
from jaxsim.rl.parts.collect import start_actors

Metrics = dict[str, Any]


class Algorithm(abc.ABC):
    """A trainer; `jaxsim.rl.programs` compiles it for all devices, `jaxsim.rl.driver` runs it.

    Inside `start` and `epoch` the axis `jaxsim.parallel.devices.AXIS` is bound. The learner must
    be the same on all devices, so gradients, statistics and metrics are averaged along this axis. A
    learner is a record with at least `obs`, the statistics of the observations, a `key`, and
    `epoch`, the number of epochs so far.

    Attributes:
      Config: the class of its settings.
      env: the environment, with `AutoReset`.
      config: the settings.
      devices: how many devices share the work.
      steps_per_epoch: environment steps of one call of `epoch` on all devices together.
      scale: from the actions of the network to those of the environment.
    """

    Config: ClassVar[type[TrainConfig]]

    def __init__(self, env: Env, config: Any, devices: int, unroll: int):
        self.env, self.config, self.devices = env, config, devices
        self.steps_per_epoch = config.envs * unroll
        self.scale = ActionRange.of(env)
        self.check_divides("envs", config.envs)

    @abc.abstractmethod
    def init(self, key) -> Any:
        """The learner before training; runs once for all devices."""

    def start(self, learner: Any, keys) -> Any:
        """The actors: one environment of this device for each key."""
        return start_actors(self.env, keys)

    @abc.abstractmethod
    def epoch(self, learner: Any, actors: Any) -> tuple[Any, Any, Metrics]:
        """Act and learn.

        Returns:
          The learner and the actors afterwards, and scalars, among them "episode_return" and
          "episode_length" (means over the episodes that ended, NaN for none) and the counts of
          `jaxsim.rl.parts.collect.Episodes`.
        """

    def learning(self, learner: Any, actors: Any) -> Metrics:
        """The learning of an epoch without its simulation, to be timed.

        Returns:
          Scalars for which all of its work must be done; empty where learning is not a part by
          itself.
        """
        del learner, actors
        return {}

    @abc.abstractmethod
    def policy(self, learner: Any) -> Policy:
        """The present policy."""

    def statistics(self, learner: Any) -> RunningStatistics | None:
        """Statistics by which observations are normalised; None for no normalisation."""
        return learner.obs if self.config.normalize_obs else None

    def normalize(self, learner: Any, obs: Float[Array, "*batch n"]) -> Float[Array, "*batch n"]:
        """Observations in the form that the networks take."""
        statistics = self.statistics(learner)
        return obs if statistics is None else statistics.normalize(obs)

    def end_epoch(self, learner: Any, obs: Float[Array, "T n obs"], key) -> Any:
        """Include the observations of an epoch in the statistics, and count the epoch.

        Call it at the end of an epoch, because all of it must use the same normalisation.
        """
        seen = learner.obs.update(obs.reshape(-1, obs.shape[-1]), AXIS)
        return learner.replace(obs=seen, key=key, epoch=learner.epoch + 1)

    def remaining(self, learner: Any) -> Float[Array, ""]:
        """The fraction of the training that remains, from 1 to 0."""
        epochs = max(1, self.config.total_steps // self.steps_per_epoch)
        return jnp.clip(1 - learner.epoch / epochs, 0.0, 1.0)

    def check_divides(self, name: str, value: int) -> None:
        """Check that a number can be divided among the devices.

        Raises:
          ConfigError: it is not a multiple of their number.
        """
        if value % self.devices:
            raise ConfigError(
                f"{name} must be a multiple of the {self.devices} devices, got {value}"
            )
