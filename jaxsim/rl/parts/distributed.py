"""What all devices share and what is split, in one process or several joined by `jax.distributed`.

Trainers write what one device does, with collectives along the axis "batch". What they learn is
the same on all devices; what acts in environments is split, with the environments in front.
"""

from typing import Any

import jax
from flax import struct

from jaxsim.parallel.devices import EVERYWHERE, SPLIT


@struct.dataclass
class Training:
    """All that a training carries from one epoch to the next.

    Attributes:
      learner: parameters, optimiser, statistics, keys and counters: the same on all devices.
      actors: states of the environments and what belongs to them, environments in front: split.
    """

    learner: Any
    actors: Any


SPECS = Training(EVERYWHERE, SPLIT)


def join(coordinator: str | None, processes: int, index: int) -> None:
    """Join the processes of one training; before anything else touches JAX.

    Args:
      coordinator: "host:port" of the first process; None leaves it to the cluster's environment.
      processes: how many there are.
      index: which of them this is, from 0.
    """
    jax.distributed.initialize(coordinator, processes, index)


def is_main() -> bool:
    """Whether this process is the one that reports and writes files."""
    return jax.process_index() == 0
