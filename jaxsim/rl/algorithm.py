"""What a trainer hands to the driver: plain functions for one device."""

import dataclasses
from collections.abc import Callable
from typing import Any

from jaxsim.rl.config import TrainConfig
from jaxsim.rl.networks import Policy

Metrics = dict[str, Any]


@dataclasses.dataclass(frozen=True)
class Algorithm:
    """A trainer, ready to run; `jaxsim.rl.programs` compiles it for all devices, `driver` runs it.

    Inside `start` and `epoch` the axis `distributed.AXIS` is bound; the learner must come out
    the same on all devices, so gradients, statistics and metrics are averaged along it.

    Attributes:
      config: its settings.
      init: `key -> learner`; runs once for all devices.
      start: `(learner, keys) -> actors`, one key for each environment of this device.
      epoch: `(learner, actors) -> (learner, actors, metrics)`; metrics are scalars, among them
        "episode_return" and "episode_length" (means over the episodes that ended, NaN for none)
        and "nonfinite" (environments that were reset because of a NaN).
      policy: `learner -> Policy`.
      steps_per_epoch: environment steps of one call of `epoch` on all devices together.
    """

    config: TrainConfig
    init: Callable[[Any], Any]
    start: Callable[[Any, Any], Any]
    epoch: Callable[[Any, Any], tuple[Any, Any, Metrics]]
    policy: Callable[[Any], Policy]
    steps_per_epoch: int
