"""Soft actor-critic (Haarnoja et al. 2018), with a replay buffer on the devices.

One epoch: every environment takes `unroll` steps with the present stochastic policy, which are
stored in a replay buffer. Then the policy, two critics and the temperature are fitted to random
batches from the buffer, `updates` times. The policy maximises rewards plus temperature times
entropy; the temperature is adapted to keep the entropy near its target. All of this is one compiled
program, in which each device has its own environments and buffer and gradients are averaged.
"""

import dataclasses
from typing import Annotated, Any

import jax
import jax.numpy as jnp
import optax
from flax import linen as nn
from flax import struct
from jax import lax
from jaxtyping import Array, Bool, Float

from jaxsim.envs import Env
from jaxsim.parallel.devices import AXIS
from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.config import NetworkConfig, TrainConfig
from jaxsim.rl.errors import ConfigError
from jaxsim.rl.networks import MLP, Policy, TanhGaussianPolicy
from jaxsim.rl.normalize import RunningStatistics
from jaxsim.rl.parts.collect import Actors, Experience, collect
from jaxsim.rl.parts.descent import Adam, average, blend, keep_finite
from jaxsim.rl.values import Count, Fraction, Positive, Range

NETWORK = NetworkConfig((128, 128), "relu")


@dataclasses.dataclass(frozen=True)
class Config(TrainConfig):
    """Settings of SAC.

    Attributes:
      unroll: steps of each environment in one epoch.
      updates: gradient steps of one epoch.
      batch: steps of the buffer in one gradient step, on all devices together.
      capacity: steps in the buffer, on all devices together.
      warmup: steps in all environments together before learning starts; the actions are random.
      discount: factor per step of the return.
      learning_rate: step size of Adam, for everything that is learnt.
      follow: rate of the target critics, the fraction of the critics in one averaging step.
      entropy: target of the policy's entropy, in nats for each action.
      initial_temperature: temperature before training.
      normalize_obs: subtract the running mean of the observations, divide by their deviation.
      reward_scale: factor on the rewards that the learner sees.
      policy: network of the policy.
      value: network of each critic.
    """

    envs: Count = 64
    unroll: Count = 1
    updates: Count = 16
    batch: Count = 256
    capacity: Count = 262_144
    warmup: Annotated[int, Range(0, 10**15)] = 8192
    discount: Fraction = 0.99
    learning_rate: Positive = 3e-4
    follow: Fraction = 0.005
    entropy: float = -1.0
    initial_temperature: Positive = 0.2
    normalize_obs: bool = False
    reward_scale: Positive = 1.0
    policy: NetworkConfig = NETWORK
    value: NetworkConfig = NETWORK


@struct.dataclass
class Learner:
    """The learner of SAC, the same on all devices.

    Attributes:
      params: parameters of "policy" and "critics", and the logarithm of the "temperature".
      target: parameters of the target critics.
      optimizer: state of Adam.
      obs: statistics of the observations.
      key: random numbers of the epochs to come.
      epoch: epochs so far, from which the position in the buffer follows.
    """

    params: dict[str, Any]
    target: Any
    optimizer: optax.OptState
    obs: RunningStatistics
    key: Any
    epoch: Any


@struct.dataclass
class Transition:
    """Steps of environments in any order, along the first axis.

    Attributes:
      obs: observation on which the action was chosen.
      action: action of the network, within (-1, 1).
      reward: reward, scaled.
      next_obs: observation after the step.
      terminated: whether the task ended; truncated episodes count as going on.
    """

    obs: Float[Array, "n obs"]
    action: Float[Array, "n nu"]
    reward: Float[Array, "n"]
    next_obs: Float[Array, "n obs"]
    terminated: Bool[Array, "n"]


@struct.dataclass
class SACActors:
    """Environments, and the buffer of the latest steps."""

    envs: Actors
    buffer: Transition


class Critics(nn.Module):
    """Two estimates of an action's value, by two networks."""

    hidden: tuple[int, ...]
    activation: str

    @nn.compact
    def __call__(self, obs, action) -> tuple[Float[Array, "*batch"], Float[Array, "*batch"]]:
        """Estimate the return that follows an action."""
        x = jnp.concatenate([obs, action], axis=-1)
        first, second = (MLP(self.hidden, 1, self.activation)(x)[..., 0] for _ in range(2))
        return first, second


class SAC(Algorithm):
    """The algorithm on an environment (with `AutoReset`), for one of the devices."""

    Config = Config

    def __init__(self, env: Env, config: Config, devices: int = 1):
        super().__init__(env, config, devices, config.unroll)
        self.check_divides("batch", config.batch)
        self.check_divides("capacity", config.capacity)
        if config.capacity % self.steps_per_epoch:
            raise ConfigError(
                f"capacity must be a multiple of envs * unroll ({self.steps_per_epoch}), "
                f"got {config.capacity}"
            )
        self.network = TanhGaussianPolicy(
            env.action_size, config.policy.hidden, config.policy.activation
        )
        self.critics = Critics(config.value.hidden, config.value.activation)
        self.adam = Adam()
        self.rows = self.steps_per_epoch // devices
        self.capacity = config.capacity // devices
        self.batch = config.batch // devices

    def init(self, key) -> Learner:
        """Parameters before training."""
        key, policy_key, critics_key = jax.random.split(key, 3)
        obs, action = jnp.zeros(self.env.observation_size), jnp.zeros(self.env.action_size)
        critics = self.critics.init(critics_key, obs, action)
        params = {
            "policy": self.network.init(policy_key, obs),
            "critics": critics,
            "temperature": jnp.log(jnp.asarray(self.config.initial_temperature, float)),
        }
        return Learner(
            params=params,
            # A copy: what the compiled epoch may overwrite must not be one array twice.
            target=jax.tree.map(jnp.copy, critics),
            optimizer=self.adam.init(params),
            obs=RunningStatistics.start(obs.shape),
            key=key,
            epoch=jnp.zeros((), int),
        )

    def start(self, learner: Learner, keys) -> SACActors:
        """Reset one environment for each key; the buffer is empty."""
        size, actions = self.env.observation_size, self.env.action_size
        empty = lambda *shape: jnp.zeros((self.capacity, *shape))  # noqa: E731
        buffer = Transition(
            empty(size), empty(actions), empty(), empty(size), jnp.zeros(self.capacity, bool)
        )
        return SACActors(super().start(learner, keys), buffer)

    def policy(self, learner: Learner) -> Policy:
        """The present policy."""
        params = learner.params["policy"]
        return Policy(params, self.statistics(learner), self.scale, self.network)

    def epoch(self, learner: Learner, actors: SACActors):
        """Collect experience, then learn from the buffer."""
        key, carry = jax.random.split(learner.key)
        key = jax.random.fold_in(key, lax.axis_index(AXIS))
        act_key, fit_key = jax.random.split(key)
        policy = self.policy(learner)
        warm = learner.epoch * self.steps_per_epoch >= self.config.warmup

        def act(obs, key):
            action = policy.distribution(obs).sample(key)
            action = jnp.where(warm, action, jax.random.uniform(key, action.shape, minval=-1.0))
            return self.scale(action), action

        envs, seen, episodes = collect(self.env, act, actors.envs, act_key, self.config.unroll)
        buffer = self.remember(actors.buffer, seen, learner.epoch)
        known = jnp.minimum((learner.epoch + 1) * self.rows, self.capacity)
        fitted, losses = self.fit(learner, buffer, known, fit_key)
        learner = jax.tree.map(lambda new, old: jnp.where(warm, new, old), fitted, learner)
        learner = self.end_epoch(learner, seen.obs, carry)
        losses["temperature"] = jnp.exp(learner.params["temperature"])
        return learner, SACActors(envs, buffer), {**episodes.metrics(), **losses}

    def learning(self, learner: Learner, actors: SACActors):
        """The gradient steps of an epoch, on the buffer as it is."""
        return self.fit(learner, actors.buffer, self.rows, learner.key)[1]

    def remember(self, buffer: Transition, seen: Experience, epoch) -> Transition:
        """Replace the oldest steps in the buffer by those of an epoch."""
        steps = Transition(
            obs=seen.obs,
            action=seen.extras,
            reward=self.config.reward_scale * seen.reward,
            next_obs=seen.next_obs,
            terminated=seen.terminated,
        )
        place = (epoch * self.rows) % self.capacity
        return jax.tree.map(
            lambda old, new: lax.dynamic_update_slice_in_dim(
                old, new.reshape(-1, *new.shape[2:]), place, 0
            ),
            buffer,
            steps,
        )

    def fit(self, learner: Learner, buffer: Transition, known, key):
        """All gradient steps of an epoch; `known` steps of the buffer are filled."""

        def body(learner, key):
            rows_key, loss_key = jax.random.split(key)
            rows = jax.random.randint(rows_key, (self.batch,), 0, known)
            return self.update(learner, jax.tree.map(lambda x: x[rows], buffer), loss_key)

        learner, losses = lax.scan(body, learner, jax.random.split(key, self.config.updates))
        return learner, {name: jnp.nanmean(x) for name, x in losses.items()}

    def update(self, learner: Learner, batch: Transition, key) -> tuple[Learner, dict[str, Array]]:
        """One gradient step of everything."""
        gradient, losses = jax.grad(self.loss, has_aux=True)(learner.params, learner, batch, key)
        gradient, losses = average((gradient, losses))
        params, optimizer = self.adam.step(
            learner.params, learner.optimizer, gradient, self.config.learning_rate
        )
        updated = learner.replace(
            params=params,
            target=blend(learner.target, params["critics"], self.config.follow),
            optimizer=optimizer,
        )
        return keep_finite((gradient, losses), updated, learner), losses

    def loss(self, params, learner: Learner, batch: Transition, key):
        """Sum of three losses; `stop_gradient` keeps each to its own parameters."""
        now_key, next_key = jax.random.split(key)
        obs, next_obs = (self.normalize(learner, x) for x in (batch.obs, batch.next_obs))
        frozen: Any = lax.stop_gradient(params)
        temperature = jnp.exp(frozen["temperature"])

        after = self.network.apply(frozen["policy"], next_obs)
        next_action, next_log_prob = after.sample_and_log_prob(next_key)
        target = soft_target(
            batch.reward,
            jnp.minimum(*self.values(learner.target, next_obs, next_action)),
            next_log_prob,
            batch.terminated,
            temperature,
            self.config.discount,
        )
        values = self.values(params["critics"], obs, batch.action)
        critic_loss = sum(0.5 * jnp.square(value - target).mean() for value in values)

        now = self.network.apply(params["policy"], obs)
        action, log_prob = now.sample_and_log_prob(now_key)
        worth = jnp.minimum(*self.values(frozen["critics"], obs, action))
        policy_loss = (temperature * log_prob - worth).mean()

        entropy = -lax.stop_gradient(log_prob).mean()
        goal = self.config.entropy * self.env.action_size
        temperature_loss = params["temperature"] * (entropy - goal)
        losses = {"critic_loss": critic_loss, "policy_loss": policy_loss, "entropy": entropy}
        return critic_loss + policy_loss + temperature_loss, lax.stop_gradient(losses)

    def values(self, params, obs, action) -> tuple[Array, Array]:
        """The values that the two critics give an action."""
        both: Any = self.critics.apply(params, obs, action)
        return both


def soft_target(
    reward: Float[Array, "*n"],
    next_value: Float[Array, "*n"],
    next_log_prob: Float[Array, "*n"],
    terminated: Bool[Array, "*n"],
    temperature: Float[Array, ""],
    discount: float,
) -> Float[Array, "*n"]:
    """Targets of the critics (Haarnoja et al. 2018, eq. 3 and 5).

    y = r + discount (1 - terminated) (min(Q1, Q2)(s', a') - temperature log p(a' | s'))

    Args:
      reward: r.
      next_value: the lesser of the target critics' values of a'.
      next_log_prob: log density of a', drawn from the present policy in s'.
      terminated: the episode ended in s'.
      temperature: reward for a nat of entropy.
      discount: factor per step.
    """
    soft_value = next_value - temperature * next_log_prob
    return reward + discount * jnp.where(terminated, 0, soft_value)
