"""Detection of processes that were forked after JAX had started.

JAX's threads do not exist in the new process, which would wait for them for ever.
"""

import os

import jax

_lost = False


def check_fork() -> None:
    """Raise an error if JAX cannot work in this process.

    Raises:
      RuntimeError: this process was forked after JAX had started.
    """
    if _lost:
        raise RuntimeError(
            "this process was forked from one in which JAX was running, whose threads it lacks: "
            'start it with context="spawn" or "forkserver", for instance gymnasium.make_vec(..., '
            'vectorization_mode="async", vector_kwargs={"context": "spawn"}); or leave '
            "vectorization_mode out, for one compiled batch without processes"
        )


def _started() -> bool:
    """Whether JAX has been used: only before that can the tested setting be changed."""
    cores = jax.config.jax_num_cpu_devices
    try:
        jax.config.update("jax_num_cpu_devices", cores + 2)
    except RuntimeError:
        return True
    jax.config.update("jax_num_cpu_devices", cores)
    return False


def _note() -> None:
    global _lost
    _lost = _lost or _started()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_note)
