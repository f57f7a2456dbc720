"""Steps of gradient descent that are the same on all devices."""

from typing import Any

import jax
import jax.numpy as jnp
import optax
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Int

from jaxsim.parallel.devices import AXIS
from jaxsim.rl.errors import ConfigError


class Adam:
    """Adam (Kingma & Ba 2015) with the step size as an argument of each step.

    Args:
      max_grad_norm: longer gradients are scaled down to this norm; None for no limit.
      momentum: averaging of gradients and of their squares, beta_1 and beta_2.
      epsilon: added to the root of the mean square.
    """

    def __init__(
        self,
        max_grad_norm: float | None = None,
        momentum: tuple[float, float] = (0.9, 0.999),
        epsilon: float = 1e-8,
    ):
        adam = optax.scale_by_adam(momentum[0], momentum[1], epsilon)
        if max_grad_norm is not None:
            adam = optax.chain(optax.clip_by_global_norm(max_grad_norm), adam)
        # Flattened, the update of all parameters is a few vector operations.
        self._adam = optax.flatten(adam)

    def init(self, params: Any) -> optax.OptState:
        """State before the first step."""
        return self._adam.init(params)

    def step(self, params: Any, state: optax.OptState, gradient: Any, rate: Any):
        """Parameters and state after a step of size `rate`."""
        step, state = self._adam.update(gradient, state)
        return jax.tree.map(lambda p, s: p - (rate * s).astype(p.dtype), params, step), state


def average(tree: Any) -> Any:
    """Mean over all devices, by one collective, because each collective synchronises devices."""
    flat, unravel = ravel_pytree(tree)
    return unravel(lax.pmean(flat, AXIS))


def keep_finite(watched: Any, new: Any, old: Any) -> Any:
    """The new values, or the old ones if one of the watched numbers is not finite.

    So numbers that are not finite never reach the parameters.
    """
    fine = jnp.isfinite(ravel_pytree(watched)[0]).all()
    return jax.tree.map(lambda a, b: jnp.where(fine, a, b), new, old)


def blend(old: Any, new: Any, part: float | jax.Array) -> Any:
    """`old + part (new - old)`, for running averages."""
    return jax.tree.map(lambda a, b: a + part * (b - a), old, new)


def minibatches(key, samples: int, passes: int, count: int) -> Int[Array, "passes*count n"]:
    """Indices of the samples of each minibatch: all samples `passes` times, shuffled each time."""
    keys = jax.random.split(key, passes)
    order = jax.vmap(lambda k: jnp.argsort(jax.random.bits(k, (samples,))))(keys)
    return order.reshape(passes * count, -1)


def check_minibatches(samples: int, count: int, of: str) -> None:
    """Check that samples can be divided into minibatches of equal size; `of` names the samples.

    Raises:
      ConfigError: they cannot.
    """
    if samples % count:
        raise ConfigError(
            f"{of} on each device ({samples}) must be a multiple of minibatches ({count})"
        )
