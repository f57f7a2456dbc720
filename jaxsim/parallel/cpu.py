"""Settings of a process for batches on a CPU, to be made before JAX starts.

They affect the whole process, so a library must not make them without being asked.
"""

import os

import jax

from jaxsim.lanes.switch import enable_lanes, lanes_installed

# Otherwise loops over a few dozen lanes are unrolled before they can be vectorised, and no option
# of a single program prevents that.
_OPTIONS, _NO_UNROLLING = "--xla_backend_extra_options=", "xla_cpu_disable_loop_unrolling"


def configure_cpu(cores: int | None = None, *, lanes: bool | None = None) -> None:
    """Prepare JAX for batches on a CPU; to be called once, before JAX is used.

    Every core becomes a device, because XLA's own threads cost more than they gain in programs of
    many small operations. The environment variable `XLA_FLAGS` tells XLA not to unroll loops:
    batches then run in smaller chunks, which fit in the first-level cache, and compilation takes
    about two thirds of the time. The command line calls this function, too.

    Args:
      cores: number of cores to use; by default all on which this process may run.
      lanes: whether a step is compiled as one kernel of `jaxsim.lanes` instead of by XLA, where
        the numbers of its model are known; needs the extra `lanes`. By default it is where that is
        installed.

    Raises:
      ValueError: fewer than one core.
      ImportError: lanes are asked for, and llvmlite is not installed.
      RuntimeError: JAX was used before.
    """
    installed = lanes_installed()
    if lanes and not installed:
        raise ImportError("configure_cpu(lanes=True) needs llvmlite: pip install llvmlite")
    cores = _available() if cores is None else cores
    if cores < 1:
        raise ValueError(f"cores must be at least 1, got {cores}")
    try:
        jax.config.update("jax_num_cpu_devices", cores)
        # Small programs, such as a step of one environment, take half as long on this thread as on
        # one that has to be woken; programs of several devices have threads of their own.
        jax.config.update("jax_cpu_enable_async_dispatch", False)
    except RuntimeError as error:
        raise RuntimeError(
            "configure_cpu comes too late: JAX has been used in this process; call it right after "
            "the imports, before anything that makes an array or loads a model"
        ) from error
    enable_lanes(installed if lanes is None else lanes)
    if not keeps_loops():
        os.environ["XLA_FLAGS"] = _with_option(os.environ.get("XLA_FLAGS", ""))


def keeps_loops() -> bool:
    """Whether XLA is told not to unroll loops."""
    return _NO_UNROLLING in os.environ.get("XLA_FLAGS", "")


def _with_option(flags: str) -> str:
    """The flags with our option added to the value of the same flag, if it is set."""
    if _OPTIONS in flags:
        return flags.replace(_OPTIONS, f"{_OPTIONS}{_NO_UNROLLING},", 1)
    return f"{flags} {_OPTIONS}{_NO_UNROLLING}".strip()


def _available() -> int:
    """Cores that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
