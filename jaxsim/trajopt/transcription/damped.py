"""One step of Levenberg and Marquardt's method on an augmented Lagrangian."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.batching import vmap
from jaxsim.trajopt.transcription.lagrangian import Multipliers, expand_lagrangian, lagrangian
from jaxsim.trajopt.transcription.protocol import Transcription

# Dampings that an iteration tries, relative to that of the last one.
_FACTORS = (0.01, 0.3, 3.0, 100.0)
LEAST_DAMPING, MOST_DAMPING = 1e-10, 1e8


class DampedStep(NamedTuple):
    """The best of several steps.

    Attributes:
      path: after it, or before it if none lowers L.
      missing: constraints there.
      damping: of the step; much more if none lowers L.
      fall: how much L is lower; infinite if it is not.
    """

    path: Any
    missing: Float[Array, "T r"]
    damping: Float[Array, ""]
    fall: Float[Array, ""]


def damped_step(
    way: Transcription, multipliers: Multipliers, path: Any, damping: Float[Array, ""]
) -> DampedStep:
    """A Gauss-Newton step on L, with the best of several dampings near that of the last one."""
    at = expand_lagrangian(way, multipliers, path)

    def attempt(damping):
        trial = way.after(at, path, at.step(damping))
        c = way.gaps(trial)
        return trial, c, lagrangian(way, multipliers, trial, c)

    before = lagrangian(way, multipliers, path, at.missing)
    dampings = jnp.clip(
        damping * jnp.array(_FACTORS, path.ctrls.dtype), LEAST_DAMPING, MOST_DAMPING
    )
    paths, cs, values = vmap(attempt)(dampings)
    best = jnp.argmin(jnp.where(jnp.isnan(values), jnp.inf, values))
    better = values[best] < before
    path, c, damping = jax.tree.map(
        lambda new, old: jnp.where(better, new[best], old),
        (paths, cs, dampings),
        (path, at.missing, 1e3 * damping),
    )
    return DampedStep(path, c, damping, jnp.where(better, before - values[best], jnp.inf))
