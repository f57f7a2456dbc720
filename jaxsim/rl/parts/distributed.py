"""The state of a training on several devices, in one or several processes.

A trainer defines the program of one device, with collectives along the axis "batch". The learner is
the same on all devices. The actors are divided along their first axis, the environments. Processes
are joined by `jax.distributed`.
"""

from typing import Any

import jax
from flax import struct

from jaxsim.parallel.devices import EVERYWHERE, SPLIT


@struct.dataclass
class Training:
    """The state of a training between two epochs.

    Attributes:
      learner: parameters, optimiser, statistics, keys and counters, the same on all devices.
      actors: states of the environments, divided among the devices along the first axis.
    """

    learner: Any
    actors: Any


SPECS = Training(EVERYWHERE, SPLIT)


def join(coordinator: str | None, processes: int, index: int) -> None:
    """Join the processes of one training; call it before any other use of JAX.

    Args:
      coordinator: "host:port" of the first process; None to use the cluster's environment.
      processes: number of processes.
      index: number of this process, from 0.
    """
    jax.distributed.initialize(coordinator, processes, index)


def is_main() -> bool:
    """Whether this is the process that reports and writes files."""
    return jax.process_index() == 0
