"""Proximal policy optimisation (Schulman et al. 2017), for many environments on all devices.

One epoch: every environment takes `unroll` steps with the present policy; advantages come from
generalised advantage estimation; then the policy and the value function are fitted by stochastic
gradients on shuffled minibatches, in `passes` passes over the data. All of this is one compiled
program, in which each device works on its own environments and gradients are averaged.
"""

import dataclasses
from typing import Any, Literal

import jax
import jax.numpy as jnp
import optax
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.envs import Env
from jaxsim.parallel.devices import AXIS
from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.config import NetworkConfig, TrainConfig
from jaxsim.rl.networks import Gaussian, GaussianPolicy, Policy, Value, divergence
from jaxsim.rl.normalize import LIMIT, RunningStatistics, discounted_returns
from jaxsim.rl.parts.collect import Actors, Experience, collect
from jaxsim.rl.parts.descent import Adam, average, check_minibatches, keep_finite, minibatches
from jaxsim.rl.parts.gae import advantages
from jaxsim.rl.values import Count, Fraction, NotNegative, Positive


@dataclasses.dataclass(frozen=True)
class Config(TrainConfig):
    """Settings of PPO.

    Attributes:
      unroll: steps of each environment in one epoch.
      minibatches: gradient steps of one pass over the data of an epoch.
      passes: number of passes over the data of an epoch.
      discount: factor per step of the return.
      decay: lambda of the advantage estimation: 1 trusts returns, 0 the value function.
      clip: the ratio of new to old probability has no effect beyond 1 +- clip.
      learning_rate: step size of Adam at the start.
      schedule: "linear" to zero at `total_steps`, "constant", or "kl": raised or lowered after
        each epoch to keep the policy's change near `target_kl`.
      target_kl: divergence of an epoch's new policy from its old one (nats) that "kl" aims at.
      max_grad_norm: longer gradients are scaled down to this norm.
      entropy: weight of the entropy bonus.
      value_weight: weight of the value function's squared error.
      normalize_obs: subtract the running mean of the observations, divide by their deviation.
      normalize_reward: divide rewards by the running deviation of the discounted returns.
      reward_scale: factor on the rewards that the learner sees.
      initial_std: deviation of the actions before training, in halves of the action range.
      policy: network of the policy.
      value: network of the value function.
    """

    unroll: Count = 32
    minibatches: Count = 8
    passes: Count = 4
    discount: Fraction = 0.99
    decay: Fraction = 0.95
    clip: Positive = 0.2
    learning_rate: Positive = 3e-4
    schedule: Literal["linear", "constant", "kl"] = "linear"
    target_kl: Positive = 0.01
    max_grad_norm: Positive = 1.0
    entropy: NotNegative = 0.0
    value_weight: NotNegative = 0.5
    normalize_obs: bool = True
    normalize_reward: bool = True
    reward_scale: Positive = 1.0
    initial_std: Positive = 1.0
    policy: NetworkConfig = dataclasses.field(default_factory=NetworkConfig)
    value: NetworkConfig = dataclasses.field(default_factory=NetworkConfig)


@struct.dataclass
class Learner:
    """The learner of PPO, the same on all devices.

    Attributes:
      params: parameters of "policy" and "value".
      optimizer: state of Adam.
      learning_rate: present step size.
      obs: statistics of the observations.
      returns: statistics of the discounted returns, which scale the rewards.
      key: random numbers of the epochs to come.
      epoch: epochs so far.
    """

    params: dict[str, Any]
    optimizer: optax.OptState
    learning_rate: Float[Array, ""]
    obs: RunningStatistics
    returns: RunningStatistics
    key: Any
    epoch: Any


@struct.dataclass
class PPOActors:
    """Environments, and the discounted sums of their rewards (for the scale of rewards)."""

    envs: Actors
    discounted: Float[Array, "n"]


@struct.dataclass
class Sample:
    """Samples for the loss, one for each step of an environment, along the first axis.

    Attributes:
      obs: normalised observation.
      action: action of the network.
      old: the distribution that it was drawn from.
      log_prob: its log probability then.
      advantage: estimated advantage, of mean 0 and deviation 1.
      target: return that the value function should have predicted.
    """

    obs: Float[Array, "n obs"]
    action: Float[Array, "n nu"]
    old: Gaussian
    log_prob: Float[Array, "n"]
    advantage: Float[Array, "n"]
    target: Float[Array, "n"]


class PPO(Algorithm):
    """The algorithm on an environment (with `AutoReset`), for one of the devices."""

    Config = Config

    def __init__(self, env: Env, config: Config, devices: int = 1):
        super().__init__(env, config, devices, config.unroll)
        samples = config.envs // devices * config.unroll
        check_minibatches(samples, config.minibatches, "envs * unroll")
        self.network: Any = GaussianPolicy(
            env.action_size, config.policy.hidden, config.policy.activation, config.initial_std
        )
        self.value: Any = Value(config.value.hidden, config.value.activation)
        self.adam = Adam(config.max_grad_norm, epsilon=1e-5)

    def init(self, key) -> Learner:
        """Parameters before training."""
        key, policy, value = jax.random.split(key, 3)
        obs = jnp.zeros(self.env.observation_size)
        params = {
            "policy": self.network.init(policy, obs),
            "value": self.value.init(value, obs),
        }
        return Learner(
            params=params,
            optimizer=self.adam.init(params),
            learning_rate=jnp.asarray(self.config.learning_rate, float),
            obs=RunningStatistics.start(obs.shape),
            returns=RunningStatistics.start(()),
            key=key,
            epoch=jnp.zeros((), int),
        )

    def start(self, learner: Learner, keys) -> PPOActors:
        """Reset one environment for each key."""
        actors = super().start(learner, keys)
        return PPOActors(actors, jnp.zeros_like(actors.episode_return))

    def policy(self, learner: Learner) -> Policy:
        """The present policy."""
        params = learner.params["policy"]
        return Policy(params, self.statistics(learner), self.scale, self.network)

    def epoch(self, learner: Learner, actors: PPOActors):
        """Collect experience, then learn from it."""
        key, carry = jax.random.split(learner.key)
        key = jax.random.fold_in(key, lax.axis_index(AXIS))
        act_key, shuffle_key = jax.random.split(key)
        policy = self.policy(learner)

        def act(obs, key):
            distribution = policy.distribution(obs)
            action = distribution.sample(key)
            return self.scale(action), (action, distribution)

        envs, seen, episodes = collect(self.env, act, actors.envs, act_key, self.config.unroll)
        discounted, reward, returns = self.scale_rewards(learner, actors.discounted, seen)
        samples = self.samples(learner, seen.replace(reward=reward))
        learner, losses = self.fit(learner, samples, shuffle_key)
        learner = self.end_epoch(learner.replace(returns=returns), seen.obs, carry)
        return learner, PPOActors(envs, discounted), {**episodes.metrics(), **losses}

    def learning(self, learner: Learner, actors: PPOActors):
        """Learn from random numbers in the place of experience."""
        del actors
        keys = jax.random.split(learner.key, 3)
        shape = self.config.unroll, self.config.envs // self.devices
        obs = jax.random.normal(keys[0], (*shape, self.env.observation_size))
        distribution = self.policy(learner).distribution(obs)
        action, done = distribution.sample(keys[1]), obs[..., 0] > LIMIT
        seen = Experience(
            obs=obs,
            action=self.scale(action),
            extras=(action, distribution),
            reward=obs[..., 0],
            next_obs=obs,
            terminated=done,
            truncated=done,
        )
        return self.fit(learner, self.samples(learner, seen), keys[2])[1]

    def scale_rewards(self, learner: Learner, before, seen: Experience):
        """Rewards in units of the deviation of the discounted returns."""
        done = seen.terminated | seen.truncated
        after, g = discounted_returns(before, seen.reward, done, self.config.discount)
        returns = learner.returns.update(g.ravel(), AXIS)
        reward = self.config.reward_scale * seen.reward
        if self.config.normalize_reward:
            reward = jnp.clip(reward / jnp.sqrt(returns.variance + 1e-8), -LIMIT, LIMIT)
        return after, reward, returns

    def samples(self, learner: Learner, seen: Experience) -> Sample:
        """Advantages and targets of all steps, and time and environments as one axis."""
        value = lambda obs: self.value.apply(learner.params["value"], obs)  # noqa: E731
        obs = self.normalize(learner, seen.obs)
        values = value(obs)
        estimate = jax.vmap(advantages, in_axes=(1,) * 5 + (None, None), out_axes=1)
        advantage = estimate(
            seen.reward,
            values,
            value(self.normalize(learner, seen.next_obs)),
            seen.terminated,
            seen.truncated,
            self.config.discount,
            self.config.decay,
        )
        mean = lax.pmean(advantage.mean(), AXIS)
        variance = lax.pmean(jnp.square(advantage - mean).mean(), AXIS)
        action, old = seen.extras
        samples = Sample(
            obs=obs,
            action=action,
            old=old,
            log_prob=old.log_prob(action),
            advantage=(advantage - mean) / jnp.sqrt(variance + 1e-8),
            target=advantage + values,
        )
        return jax.tree.map(lambda x: x.reshape(-1, *x.shape[2:]), samples)

    def fit(self, learner: Learner, samples: Sample, key) -> tuple[Learner, dict[str, Array]]:
        """All gradient steps of an epoch."""
        count = samples.advantage.shape[0]
        order = minibatches(key, count, self.config.passes, self.config.minibatches)
        if self.config.schedule == "linear":
            rate = self.config.learning_rate * self.remaining(learner)
            learner = learner.replace(learning_rate=rate.astype(float))

        def body(learner, rows):
            return self.update(learner, jax.tree.map(lambda x: x[rows], samples))

        learner, losses = lax.scan(body, learner, order)
        last = {name: x[-self.config.minibatches :] for name, x in losses.items()}
        losses = {name: jnp.nanmean(x) for name, x in last.items()}
        rate = self.next_rate(learner.learning_rate, losses["kl"])
        losses |= {
            "learning_rate": rate,
            "std": jnp.exp(learner.params["policy"]["params"]["log_std"]).mean(),
        }
        return learner.replace(learning_rate=rate), losses

    def update(self, learner: Learner, samples: Sample) -> tuple[Learner, dict[str, Array]]:
        """One gradient step on a minibatch."""
        gradient, losses = jax.grad(self.loss, has_aux=True)(learner.params, samples)
        gradient, losses = average((gradient, losses))
        params, optimizer = self.adam.step(
            learner.params, learner.optimizer, gradient, learner.learning_rate
        )
        updated = learner.replace(params=params, optimizer=optimizer)
        return keep_finite((gradient, losses), updated, learner), losses

    def loss(self, params, samples: Sample):
        """The clipped objective, the value function's error and the entropy bonus.

        With r the ratio of new to old probability: -min(r A, clip(r, 1 - c, 1 + c) A).
        """
        new = self.network.apply(params["policy"], samples.obs)
        log_ratio = new.log_prob(samples.action) - samples.log_prob
        ratio = jnp.exp(log_ratio)
        clipped = jnp.clip(ratio, 1 - self.config.clip, 1 + self.config.clip)
        policy_loss = -jnp.minimum(ratio * samples.advantage, clipped * samples.advantage).mean()
        value = self.value.apply(params["value"], samples.obs)
        value_loss = 0.5 * jnp.square(value - samples.target).mean()
        entropy = new.entropy().mean()
        loss = policy_loss + self.config.value_weight * value_loss - self.config.entropy * entropy
        losses = {
            "policy_loss": policy_loss,
            "value_loss": value_loss,
            "entropy": entropy,
            "kl": divergence(lax.stop_gradient(samples.old), new).mean(),
            "clipped": (jnp.abs(ratio - 1) > self.config.clip).mean(),
        }
        return loss, lax.stop_gradient(losses)

    def next_rate(self, rate, kl):
        """The step size after an epoch that moved the policy by `kl`."""
        if self.config.schedule != "kl":
            return rate
        factor = jnp.where(kl > 2 * self.config.target_kl, 1 / 1.5, 1.0)
        factor = jnp.where(kl < 0.5 * self.config.target_kl, 1.5, factor)
        return jnp.clip(rate * factor, 1e-5, 1e-2).astype(rate.dtype)
