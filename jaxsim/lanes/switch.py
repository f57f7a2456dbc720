"""Whether time steps become kernels: one setting for the process."""

import contextlib
import functools
import importlib.util
from collections.abc import Iterator

import jax

_enabled: bool | None = None
_in_kernel = False


def enable_lanes(on: bool) -> None:
    """Turn kernels on or off for programs that are traced from now on.

    Without it they are on where JAX runs on a GPU and the extra `lanes` is installed. On a CPU,
    `jaxsim.configure_cpu` turns them on.
    """
    global _enabled
    _enabled = on


def lanes_enabled() -> bool:
    """Whether time steps become kernels; within another kernel they do."""
    if _in_kernel:
        return True
    if _enabled is None:
        return jax.default_backend() == "gpu" and lanes_installed()
    return _enabled


def tracing_cpu_kernel() -> bool:
    """Whether the function of a kernel is being traced, on a machine where JAX runs on a CPU."""
    return _in_kernel and jax.default_backend() == "cpu"


def lanes_for_one() -> bool:
    """Whether the program of a single environment becomes a kernel, which changes no setting.

    It does where the extra `lanes` is installed, unless kernels were turned off.
    """
    return lanes_installed() if _enabled is None else _enabled


@contextlib.contextmanager
def within_kernel() -> Iterator[None]:
    """For the time that the function of a kernel is traced."""
    global _in_kernel
    before, _in_kernel = _in_kernel, True
    try:
        yield
    finally:
        _in_kernel = before


@functools.cache
def lanes_installed() -> bool:
    """Whether the compiler that kernels need is installed."""
    return importlib.util.find_spec("llvmlite") is not None
