"""Compilation of one program for all devices, each with a part of the batch."""

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.sharding import Mesh, NamedSharding, PartitionSpec

from jaxsim.arrays.memo import is_traced, once_for_each
from jaxsim.batching.sections import sectioned

AXIS = "batch"
# Passes of XLA's CPU compiler: threads for single kernels; the end of optimisation barriers; and
# its own sections, of small loops only and without barriers.
DISABLED = "cpu-parallel-task-assigner", "cse_barrier_expander", "small-while-loop-hoisting"
# What a GPU does without asking the host in between: XLA's defaults, and loops and branches.
BUFFERED = "FUSION", "CUBLAS", "CUBLASLT", "CUSTOM_CALL", "CUDNN", "WHILE", "CONDITIONAL"
SPLIT, EVERYWHERE = PartitionSpec(AXIS), PartitionSpec()


def device_mesh(devices: Sequence[jax.Device] | None = None) -> Mesh:
    """A one-dimensional mesh of the given devices, or of all devices of all processes."""
    return Mesh(np.array(jax.devices() if devices is None else devices), (AXIS,))


def dividing_mesh(batch: int) -> Mesh:
    """A mesh of the largest number of this process's devices that divides the batch evenly."""
    devices = jax.local_devices()
    return device_mesh(devices[: max(n for n in range(1, len(devices) + 1) if batch % n == 0)])


def compiler_options(platform: str) -> dict[str, Any] | None:
    """Compiler options for many small kernels over long vectors; None for XLA's defaults."""
    if platform == "cpu":
        return _cpu_options()
    return _gpu_options() if platform == "gpu" else None


def _cpu_options() -> dict[str, Any]:
    """Options for a CPU, where each device is one thread.

    XLA's own threads cost more than they gain: those inside kernels, and those that run independent
    kernels, whose operands are then in another core's cache. The first are disabled with the pass
    that assigns them, the second by a schedule that reuses memory early. Optimisation barriers are
    kept, because sections need them; they cost nothing at run time. Vectors of the processor's full
    width are 3 to 5 per cent faster than LLVM's default.
    """
    return {
        "xla_cpu_multi_thread_eigen": False,
        "xla_cpu_prefer_vector_width": 512,
        "xla_cpu_scheduler_type": "CPU_SCHEDULER_TYPE_MEMORY_OPTIMIZED",
        "xla_disable_hlo_passes": ",".join(DISABLED),
    }


@functools.cache
def _gpu_options() -> dict[str, Any] | None:
    """Options for a GPU: loops and branches in command buffers, if the compiler supports them.

    Otherwise XLA waits for the device after each iteration of a loop to read the condition. On an
    H100 with 8,192 environments this made hopper 1.6 times, half_cheetah and ant 1.3 times as fast,
    and a humanoid 3 per cent slower.
    """
    options = {"xla_gpu_enable_command_buffer": ",".join(BUFFERED)}
    try:
        jax.jit(lambda x: x, compiler_options=options).lower(0.0).compile()
    except jax.errors.JaxRuntimeError:
        return None
    return options


def compiled(f: Callable, platform: str) -> Callable:
    """Compile a function for one device of a platform; the result cannot be differentiated."""
    return jax.jit(sectioned(f, platform), compiler_options=compiler_options(platform))


def parallel(f: Callable, mesh: Mesh, in_specs: Any, out_specs: Any, donate: Any = ()) -> Callable:
    """Compile a function of one device's part for all devices.

    Args:
      f: the function; collectives along `AXIS` are allowed.
      mesh: the devices.
      in_specs: how the arguments are divided, as for `jax.shard_map`.
      out_specs: how the results are divided.
      donate: indices of arguments whose memory may be used for the results.
    """
    platform = mesh.devices.flat[0].platform
    part = sectioned(f, platform)
    mapped = jax.shard_map(part, mesh=mesh, in_specs=in_specs, out_specs=out_specs, check_vma=False)
    return jax.jit(
        mapped,
        # Said explicitly, or arrays of size zero come back unsplit and must be compiled for anew.
        out_shardings=shardings(mesh, out_specs),
        donate_argnums=donate,
        compiler_options=compiler_options(platform),
    )


def shardings(mesh: Mesh, specs: Any) -> Any:
    """The shardings of a tree of partition specs."""
    is_spec = lambda x: isinstance(x, PartitionSpec)  # noqa: E731
    return jax.tree.map(lambda spec: NamedSharding(mesh, spec), specs, is_leaf=is_spec)


@once_for_each
def everywhere(tree: Any, mesh: Mesh) -> Any:
    """A tree on all devices; copied only once, because copying takes longer than short programs."""
    return jax.device_put(tree, shardings(mesh, EVERYWHERE))


def split(tree: Any, mesh: Mesh) -> Any:
    """A tree divided along its first axis, with each device's part on that device.

    Arrays on a CPU are passed as NumPy views of the same memory: JAX would run a program for each
    part of each array, which takes three times as long.
    """
    view = lambda x: np.asarray(x) if _is_on_one_cpu(x) else x  # noqa: E731
    tree = tree if mesh.size == 1 else jax.tree.map(view, tree)
    return jax.device_put(tree, shardings(mesh, SPLIT))


def _is_on_one_cpu(x: Any) -> bool:
    if not isinstance(x, jax.Array) or is_traced(x):
        return False
    return len(x.devices()) == 1 and next(iter(x.devices())).platform == "cpu"
