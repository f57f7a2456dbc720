"""One program on all devices: of one process, or of several joined by `jax.distributed`.

Trainers write what one device does, with collectives along the axis "batch". What they learn is
the same on all devices; what acts in environments is split, with the environments in front.
"""

from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from flax import struct
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxsim.batch.chunks import compiler_options

AXIS = "batch"


@struct.dataclass
class Training:
    """All that a training carries from one epoch to the next.

    Attributes:
      learner: parameters, optimiser, statistics, keys and counters: the same on all devices.
      actors: states of the environments and what belongs to them, environments in front: split.
    """

    learner: Any
    actors: Any


SPECS = Training(PartitionSpec(), PartitionSpec(AXIS))


def device_mesh() -> Mesh:
    """All devices of all processes in a row."""
    return Mesh(np.array(jax.devices()), (AXIS,))


def parallel(f: Callable, mesh: Mesh, in_specs: Any, out_specs: Any, donate: Any = ()) -> Callable:
    """Compile a function of one device's part for all devices.

    Args:
      f: the function; collectives along `AXIS` are allowed.
      mesh: the devices.
      in_specs: how the arguments are split, as for `jax.shard_map`.
      out_specs: the same for the results.
      donate: indices of arguments whose memory may be used for the results.
    """
    mapped = jax.shard_map(f, mesh=mesh, in_specs=in_specs, out_specs=out_specs, check_vma=False)
    return jax.jit(
        mapped,
        # Said explicitly, or arrays of size zero come back unsplit and must be compiled for anew.
        out_shardings=shardings(mesh, out_specs),
        donate_argnums=donate,
        compiler_options=compiler_options(mesh.devices.flat[0].platform),
    )


def shardings(mesh: Mesh, specs: Any) -> Any:
    """The shardings of a tree of partition specs."""
    is_spec = lambda x: isinstance(x, PartitionSpec)  # noqa: E731
    return jax.tree.map(lambda spec: NamedSharding(mesh, spec), specs, is_leaf=is_spec)


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
