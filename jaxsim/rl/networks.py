"""Networks of the trainers: multilayer perceptrons, action distributions, policies.

All take observations with any leading axes, so that a batch is one matrix product.
"""

from collections.abc import Callable, Sequence
from typing import Any, get_args

import jax
import jax.numpy as jnp
import numpy as np
from flax import linen as nn
from flax import struct
from jaxtyping import Array, Float

from jaxsim.rl.normalize import RunningStatistics
from jaxsim.rl.values import Activation

ACTIVATIONS: dict[str, Callable] = {name: getattr(nn, name) for name in get_args(Activation)}


class MLP(nn.Module):
    """Dense layers with an activation between them.

    Attributes:
      hidden: units of the hidden layers.
      out: units of the last layer, which has no activation.
      activation: a key of `ACTIVATIONS`.
      last_scale: gain of the orthogonal initial weights of the last layer.
      layer_norm: whether to normalise each hidden layer; stabilises gradients of long rollouts.
    """

    hidden: Sequence[int]
    out: int
    activation: str = "tanh"
    last_scale: float = 1.0
    layer_norm: bool = False

    @nn.compact
    def __call__(self, x: Float[Array, "*batch n"]) -> Float[Array, "*batch out"]:
        """Evaluate the network."""
        for units in self.hidden:
            x = nn.Dense(units, kernel_init=nn.initializers.orthogonal(2**0.5))(x)
            x = ACTIVATIONS[self.activation](x)
            if self.layer_norm:
                x = nn.LayerNorm()(x)
        return nn.Dense(self.out, kernel_init=nn.initializers.orthogonal(self.last_scale))(x)


class Value(nn.Module):
    """State value: a perceptron with one output, whose axis is dropped."""

    hidden: Sequence[int]
    activation: str = "tanh"
    layer_norm: bool = False

    @nn.compact
    def __call__(self, obs: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """Estimate the return that follows an observation."""
        return MLP(self.hidden, 1, self.activation, layer_norm=self.layer_norm)(obs)[..., 0]


@struct.dataclass
class Gaussian:
    """Independent normal distributions, one for each action.

    Attributes:
      mean: means.
      log_std: logarithms of the standard deviations, of the same shape.
    """

    mean: Float[Array, "*batch n"]
    log_std: Float[Array, "*batch n"]

    def mode(self) -> Float[Array, "*batch n"]:
        """The most probable action."""
        return self.mean

    def sample(self, key) -> Float[Array, "*batch n"]:
        """A random action."""
        noise = jax.random.normal(key, self.mean.shape, self.mean.dtype)
        return self.mean + jnp.exp(self.log_std) * noise

    def log_prob(self, action: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """Log density, the sum of -(a_i - mu_i)^2 / (2 sigma_i^2) - log sigma_i - log(2 pi)/2."""
        scaled = (action - self.mean) * jnp.exp(-self.log_std)
        return -jnp.sum(0.5 * scaled**2 + self.log_std + 0.5 * np.log(2 * np.pi).item(), axis=-1)

    def entropy(self) -> Float[Array, "*batch"]:
        """sum_i log sigma_i + log(2 pi e) / 2, in nats."""
        return jnp.sum(self.log_std + 0.5 * np.log(2 * np.pi * np.e).item(), axis=-1)


@struct.dataclass
class TanhGaussian:
    """The hyperbolic tangent of a normal variable: actions strictly within (-1, 1).

    Attributes:
      mean: means before the tangent.
      log_std: logarithms of the standard deviations before the tangent.
    """

    mean: Float[Array, "*batch n"]
    log_std: Float[Array, "*batch n"]

    def mode(self) -> Float[Array, "*batch n"]:
        """The image of the mean."""
        return jnp.tanh(self.mean)

    def sample(self, key) -> Float[Array, "*batch n"]:
        """A random action, differentiable with respect to mean and deviation."""
        return self.sample_and_log_prob(key)[0]

    def sample_and_log_prob(self, key) -> tuple[Float[Array, "*batch n"], Float[Array, "*batch"]]:
        """A random action and its log density.

        With u the normal variable, log p(tanh u) = log p(u) - sum_i log(1 - tanh^2 u_i), where
        log(1 - tanh^2 u) = 2 (log 2 - u - softplus(-2 u)) stays finite for large u.
        """
        normal = Gaussian(self.mean, self.log_std)
        u = normal.sample(key)
        stretch = 2 * (np.log(2).item() - u - jax.nn.softplus(-2 * u))
        return jnp.tanh(u), normal.log_prob(u) - jnp.sum(stretch, axis=-1)


def divergence(p: Gaussian | TanhGaussian, q: Gaussian | TanhGaussian) -> Float[Array, "*batch"]:
    """KL(p || q) in nats: sum_i log(s_q / s_p) + (s_p^2 + d^2) / (2 s_q^2) - 1/2.

    d is the distance of the means, s a standard deviation. The tangent of both changes nothing.
    """
    variance_ratio = jnp.exp(2 * (p.log_std - q.log_std))
    distance = jnp.square((p.mean - q.mean) * jnp.exp(-q.log_std))
    return 0.5 * jnp.sum(variance_ratio + distance - 1 - jnp.log(variance_ratio), axis=-1)


class GaussianPolicy(nn.Module):
    """A normal distribution whose deviation does not depend on the observation (PPO).

    Attributes:
      actions: number of actions.
      hidden: units of the hidden layers.
      activation: a key of `ACTIVATIONS`.
      initial_std: standard deviation before training.
    """

    actions: int
    hidden: Sequence[int]
    activation: str = "tanh"
    initial_std: float = 1.0

    @nn.compact
    def __call__(self, obs: Float[Array, "*batch n"]) -> Gaussian:
        """Distribution of the action."""
        mean = MLP(self.hidden, self.actions, self.activation, last_scale=0.01)(obs)
        start = nn.initializers.constant(np.log(self.initial_std).item())
        log_std = self.param("log_std", start, (self.actions,))
        return Gaussian(mean, jnp.broadcast_to(log_std, mean.shape))


class TanhGaussianPolicy(nn.Module):
    """A squashed normal distribution whose deviation depends on the observation (SAC, SHAC).

    Attributes:
      actions: number of actions.
      hidden: units of the hidden layers.
      activation: a key of `ACTIVATIONS`.
      min_log_std: lower limit of the logarithm of the deviation, approached smoothly.
      max_log_std: upper limit.
      layer_norm: as in `MLP`.
      last_scale: as in `MLP`.
    """

    actions: int
    hidden: Sequence[int]
    activation: str = "relu"
    min_log_std: float = -5.0
    max_log_std: float = 2.0
    layer_norm: bool = False
    last_scale: float = 0.01

    @nn.compact
    def __call__(self, obs: Float[Array, "*batch n"]) -> TanhGaussian:
        """Distribution of the action."""
        layers = MLP(
            self.hidden, 2 * self.actions, self.activation, self.last_scale, self.layer_norm
        )
        mean, raw = jnp.split(layers(obs), 2, axis=-1)
        low, high = self.min_log_std, self.max_log_std
        return TanhGaussian(mean, low + 0.5 * (high - low) * (1 + jnp.tanh(raw)))


@struct.dataclass
class ActionRange:
    """Map from actions of a network, about -1 to 1, to those of an environment within its limits.

    Attributes:
      middle: middle of the range; 0 for an unbounded action.
      half: half of the width; 1 for an unbounded action.
      low: lower limits, which may be infinite.
      high: upper limits.
    """

    middle: Float[Array, "n"]
    half: Float[Array, "n"]
    low: Float[Array, "n"]
    high: Float[Array, "n"]

    @classmethod
    def of(cls, env: Any) -> "ActionRange":
        """The range of an environment's actions."""
        low, high = np.asarray(env.action_low), np.asarray(env.action_high)
        limited = np.isfinite(low) & np.isfinite(high)
        middle = np.where(limited, (np.where(limited, high, 0) + np.where(limited, low, 0)) / 2, 0)
        half = np.where(limited, (np.where(limited, high, 1) - np.where(limited, low, -1)) / 2, 1)
        return cls(*(jnp.asarray(x, float) for x in (middle, half, low, high)))

    def __call__(self, action: Float[Array, "*batch n"]) -> Float[Array, "*batch n"]:
        """Scale and clip."""
        middle, half, low, high = (
            jnp.broadcast_to(x, action.shape) for x in (self.middle, self.half, self.low, self.high)
        )
        return jnp.clip(middle + half * action, low, high)


@struct.dataclass(eq=False)  # compared by identity, so that `jax.jit(policy)` works
class Policy:
    """A trained policy: `policy(obs)` is the deterministic action in the environment's units.

    Attributes:
      params: parameters of the network.
      statistics: statistics of the observations, for their normalisation; None for none.
      scale: map from the network's actions to the environment's.
      network: the module, which gives a distribution with `mode()` and `sample(key)`.
    """

    params: Any
    statistics: RunningStatistics | None
    scale: ActionRange
    network: Any = struct.field(pytree_node=False)

    def distribution(self, obs: Float[Array, "*batch n"]):
        """Distribution of the network's action, before scaling."""
        if self.statistics is not None:
            obs = self.statistics.normalize(obs)
        return self.network.apply(self.params, obs)

    def __call__(self, obs: Float[Array, "*batch n"]) -> Float[Array, "*batch m"]:
        """The deterministic action for one observation or a batch of them."""
        return self.scale(self.distribution(obs).mode())
