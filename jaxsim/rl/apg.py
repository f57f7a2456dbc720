"""Analytic policy gradient: the gradient of the return itself, through truncated rollouts.

One epoch: every environment takes `unroll` steps with the present policy; the gradient of the
discounted rewards with respect to the policy's parameters flows back through policy and physics,
and Adam takes one step. There is no value function. The gradient is truncated every `horizon`
steps, because it explodes for long horizons (Metz et al. 2021, "Gradients are not all you need").
All of this is one compiled program, in which each device works on its own environments and
gradients are averaged.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.envs import Env
from jaxsim.parallel.devices import AXIS
from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.config import NetworkConfig, TrainConfig
from jaxsim.rl.errors import ConfigError
from jaxsim.rl.networks import Policy, TanhGaussianPolicy
from jaxsim.rl.normalize import RunningStatistics
from jaxsim.rl.parts.collect import Actors, collect
from jaxsim.rl.parts.descent import Adam, average, keep_finite
from jaxsim.rl.parts.differentiable import (
    NO_LIMIT,
    Differentiable,
    cut_episodes,
    discounts,
    spread_episodes,
)
from jaxsim.rl.values import Average, Count, Fraction, NotNegative, Positive

NETWORK = NetworkConfig(activation="elu")


@dataclasses.dataclass(frozen=True)
class Config(TrainConfig):
    """Settings of the analytic policy gradient.

    Attributes:
      unroll: steps of each environment for one step of the policy.
      horizon: steps through which gradients flow; divides `unroll`.
      episode_steps: length at which training truncates episodes, so that starts are seen more
        often. None for the length of the task.
      discount: factor per step of the return, within a horizon.
      learning_rate: step size of Adam at the start; decreases to zero.
      momentum: Adam's averaging of gradients and of their squares.
      max_grad_norm: longer gradients are scaled down to this norm.
      max_step_gradient: longer gradients of one environment with respect to the state and
        action of one step are scaled down to this norm.
      normalize_obs: subtract the running mean of the observations, divide by their deviation.
      entropy: reward for a nat of the policy's entropy in each step.
      policy: network of the policy.
    """

    envs: Count = 128
    unroll: Count = 64
    horizon: Count = 64
    episode_steps: Count | None = None
    discount: Fraction = 1.0
    learning_rate: Positive = 2e-3
    momentum: tuple[Average, Average] = (0.7, 0.95)
    max_grad_norm: Positive = 1.0
    max_step_gradient: Positive = NO_LIMIT
    normalize_obs: bool = True
    entropy: NotNegative = 0.0
    policy: NetworkConfig = NETWORK


@struct.dataclass
class Learner:
    """The learner, the same on all devices.

    Attributes:
      params: parameters of the policy.
      optimizer: state of Adam.
      obs: statistics of the observations.
      key: random numbers of the epochs to come.
      epoch: epochs so far.
    """

    params: Any
    optimizer: optax.OptState
    obs: RunningStatistics
    key: Any
    epoch: Any


class APG(Algorithm):
    """The algorithm on an environment (with `AutoReset`), for one of the devices."""

    Config = Config

    def __init__(self, env: Env, config: Config, devices: int = 1):
        env = Differentiable(cut_episodes(env, config.episode_steps), config.max_step_gradient)
        super().__init__(env, config, devices, config.unroll)
        if config.unroll % config.horizon:
            raise ConfigError(
                f"unroll must be a multiple of horizon ({config.horizon}), got {config.unroll}"
            )
        self.network = TanhGaussianPolicy(
            env.action_size, config.policy.hidden, config.policy.activation
        )
        self.adam = Adam(config.max_grad_norm, config.momentum)

    def init(self, key) -> Learner:
        """Parameters before training."""
        key, params_key = jax.random.split(key)
        obs = jnp.zeros(self.env.observation_size)
        params = self.network.init(params_key, obs)
        return Learner(
            params=params,
            optimizer=self.adam.init(params),
            obs=RunningStatistics.start(obs.shape),
            key=key,
            epoch=jnp.zeros((), int),
        )

    def start(self, learner: Learner, keys) -> Actors:
        """Reset one environment for each key, with first episodes of different lengths."""
        return spread_episodes(super().start(learner, keys), keys, self.config.episode_steps)

    def policy(self, learner: Learner) -> Policy:
        """The present policy."""
        return Policy(learner.params, self.statistics(learner), self.scale, self.network)

    def epoch(self, learner: Learner, actors: Actors):
        """Improve the policy by the gradient of a rollout."""
        key, carry = jax.random.split(learner.key)
        key = jax.random.fold_in(key, lax.axis_index(AXIS))
        gradient, (actors, obs, episodes, objective) = jax.grad(self.loss, has_aux=True)(
            learner.params, learner, actors, key
        )
        gradient, objective = average((gradient, objective))
        params, optimizer = self.adam.step(
            learner.params,
            learner.optimizer,
            gradient,
            self.config.learning_rate * self.remaining(learner),
        )
        improved = learner.replace(params=params, optimizer=optimizer)
        learner = keep_finite((gradient, objective), improved, learner)
        learner = self.end_epoch(learner, obs, carry)
        losses = {"objective": objective, "policy_gradient": optax.tree.norm(gradient)}
        return learner, actors, {**episodes.metrics(), **losses}

    def loss(self, params, learner: Learner, actors: Actors, key):
        """Minus the mean objective of this device's environments, and their experience."""
        policy = self.policy(learner.replace(params=params))

        def act(obs, key):
            action, log_prob = policy.distribution(obs).sample_and_log_prob(key)
            return self.scale(action), -log_prob

        def window(actors, key):
            actors, seen, episodes = collect(self.env, act, actors, key, self.config.horizon)
            objective = jax.vmap(truncated_return, in_axes=(1, 1, None))(
                seen.reward + self.config.entropy * seen.extras,
                seen.terminated | seen.truncated,
                self.config.discount,
            ).mean()
            # Truncate the gradient: the next window starts from the state as a constant.
            return lax.stop_gradient(actors), (objective, lax.stop_gradient((seen.obs, episodes)))

        keys = jax.random.split(key, self.config.unroll // self.config.horizon)
        actors, (objective, (obs, episodes)) = lax.scan(window, actors, keys)
        objective = objective.mean()
        episodes = jax.tree.map(jnp.sum, episodes)
        return -objective, (actors, obs, episodes, lax.stop_gradient(objective))


def truncated_return(
    reward: Float[Array, "T"], done: Bool[Array, "T"], discount: float
) -> Float[Array, ""]:
    """sum_t w_t r_t, with w_t the discount since the last start of an episode, or of the data.

    Args:
      reward: r_t.
      done: whether the episode ended with step t, for either reason.
      discount: factor per step.
    """
    return jnp.sum(discounts(done, discount).astype(reward.dtype) * reward)
