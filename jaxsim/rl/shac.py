"""Short-horizon actor-critic (Xu et al. 2022): policy gradients through the simulation.

One epoch: every environment takes `horizon` steps with the present policy; the gradient of the
lambda-returns of these steps flows back through policy and physics to the policy's parameters. A
short horizon bounds the gradient, and the critic estimates the rewards after it. Then the critic is
fitted to the same lambda-returns, whose values are those of the target critic, a running average of
the critic. All of this is one compiled program, in which each device works on its own environments
and gradients are averaged.

The paper's objective is the return of the first step, with a value at the horizon. The mean of the
lambda-returns of all steps (as in Dreamer, Hafner et al. 2020) also has the values of the states
between: a fall within the horizon would otherwise say nothing, because the reward of health is
constant until it.

Three things keep the policy from swinging once it walks: a bonus for entropy keeps its noise, which
smooths gradients through contact; an epoch moves it by a small divergence at most (a trust region,
Schulman et al. 2015); and what is evaluated, and returned in the end, is a running average of its
parameters (Polyak & Juditsky 1992).
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
from jaxsim.rl.networks import Policy, TanhGaussianPolicy, Value, divergence
from jaxsim.rl.normalize import RunningStatistics
from jaxsim.rl.parts.collect import Actors, Experience, collect
from jaxsim.rl.parts.descent import (
    Adam,
    average,
    blend,
    check_minibatches,
    keep_finite,
    minibatches,
)
from jaxsim.rl.parts.differentiable import (
    NO_LIMIT,
    Differentiable,
    cut_episodes,
    spread_episodes,
)
from jaxsim.rl.values import Average, Count, Fraction, NotNegative, Positive

NETWORK = NetworkConfig(activation="elu")

# Part of the present policy in one averaging step: the average is that of some 50 epochs.
RECENT = 0.02


@dataclasses.dataclass(frozen=True)
class Config(TrainConfig):
    """Settings of SHAC.

    Attributes:
      horizon: steps of each environment in one epoch, through which gradients flow. Through
        contact they are of use for some 0.2 to 0.4 s.
      episode_steps: length at which training truncates episodes, so that starts are seen more
        often; the critic estimates the rest. None for the length of the task.
      discount: factor per step of the return.
      decay: lambda of the returns: 1 trusts rewards, 0 the target critic.
      follow: rate of the target critic, the fraction of the critic in one averaging step.
      minibatches: gradient steps of the critic in one pass over the data of an epoch.
      passes: number of passes of the critic over the data of an epoch.
      max_kl: an epoch's step is shortened where the new policy would be further than this from the
        old one (nats, the mean over the states of the epoch).
      policy_rate: step size of Adam for the policy at the start; decreases to zero.
      value_rate: the same for the critic.
      momentum: Adam's averaging of gradients and of their squares, for both.
      max_grad_norm: longer gradients are scaled down to this norm.
      max_step_gradient: longer gradients of one environment with respect to the state and
        action of one step are scaled down to this norm.
      normalize_obs: subtract the running mean of the observations, divide by their deviation.
      reward_scale: factor on the rewards that the learner sees.
      entropy: reward for a nat of the policy's entropy in each step, after scaling.
      policy: network of the policy.
      value: network of the critic.
    """

    envs: Count = 128
    horizon: Count = 32
    episode_steps: Count | None = None
    discount: Fraction = 0.99
    decay: Fraction = 0.95
    follow: Fraction = 0.8
    minibatches: Count = 4
    passes: Count = 4
    max_kl: Positive = 0.02
    policy_rate: Positive = 2e-3
    value_rate: Positive = 1e-3
    momentum: tuple[Average, Average] = (0.7, 0.95)
    max_grad_norm: Positive = 1.0
    max_step_gradient: Positive = NO_LIMIT
    normalize_obs: bool = True
    reward_scale: Positive = 1.0
    entropy: NotNegative = 0.0
    policy: NetworkConfig = NETWORK
    value: NetworkConfig = NETWORK


@struct.dataclass
class Learner:
    """The learner of SHAC, the same on all devices.

    Attributes:
      policy: parameters of the policy that acts.
      mean_policy: their running average.
      value: parameters of the critic.
      target: parameters of the target critic.
      policy_optimizer: state of Adam.
      value_optimizer: state of Adam.
      obs: statistics of the observations.
      key: random numbers of the epochs to come.
      epoch: epochs so far.
    """

    policy: Any
    mean_policy: Any
    value: Any
    target: Any
    policy_optimizer: optax.OptState
    value_optimizer: optax.OptState
    obs: RunningStatistics
    key: Any
    epoch: Any


class SHAC(Algorithm):
    """The algorithm on an environment (with `AutoReset`), for one of the devices."""

    Config = Config

    def __init__(self, env: Env, config: Config, devices: int = 1):
        env = Differentiable(cut_episodes(env, config.episode_steps), config.max_step_gradient)
        super().__init__(env, config, devices, config.horizon)
        samples = config.envs // devices * config.horizon
        check_minibatches(samples, config.minibatches, "envs * horizon")
        self.network = TanhGaussianPolicy(
            env.action_size, config.policy.hidden, config.policy.activation, layer_norm=True
        )
        self.value = Value(config.value.hidden, config.value.activation, layer_norm=True)
        self.adam = Adam(config.max_grad_norm, config.momentum)

    def init(self, key) -> Learner:
        """Parameters before training."""
        key, policy_key, value_key = jax.random.split(key, 3)
        obs = jnp.zeros(self.env.observation_size)
        policy, value = self.network.init(policy_key, obs), self.value.init(value_key, obs)
        # Copies: what the compiled epoch may overwrite must not be one array twice.
        return Learner(
            policy=policy,
            mean_policy=jax.tree.map(jnp.copy, policy),
            value=value,
            target=jax.tree.map(jnp.copy, value),
            policy_optimizer=self.adam.init(policy),
            value_optimizer=self.adam.init(value),
            obs=RunningStatistics.start(obs.shape),
            key=key,
            epoch=jnp.zeros((), int),
        )

    def start(self, learner: Learner, keys) -> Actors:
        """Reset one environment for each key, with first episodes of different lengths."""
        return spread_episodes(super().start(learner, keys), keys, self.config.episode_steps)

    def policy(self, learner: Learner) -> Policy:
        """The averaged policy, which is evaluated and returned."""
        return self.with_params(learner, learner.mean_policy)

    def with_params(self, learner: Learner, params) -> Policy:
        """The policy with other parameters."""
        return Policy(params, self.statistics(learner), self.scale, self.network)

    def epoch(self, learner: Learner, actors: Actors):
        """Improve the policy by a rollout, then the critic by its experience."""
        key, carry = jax.random.split(learner.key)
        key = jax.random.fold_in(key, lax.axis_index(AXIS))
        act_key, shuffle_key = jax.random.split(key)
        gradient, (actors, seen, returns, episodes) = jax.grad(self.loss, has_aux=True)(
            learner.policy, learner, actors, act_key
        )
        gradient, objective = average((gradient, returns.mean()))
        norm = optax.tree.norm(gradient)
        rate = self.remaining(learner)
        learner = self.improve(learner, gradient, rate * self.config.policy_rate, seen.obs)
        rate = rate * self.config.value_rate
        learner, value_loss = self.fit(learner, seen.obs, returns, shuffle_key, rate)
        target = blend(learner.target, learner.value, self.config.follow)
        learner = self.end_epoch(learner.replace(target=target), seen.obs, carry)
        losses = {"objective": objective, "policy_gradient": norm, "value_loss": value_loss}
        return learner, actors, {**episodes.metrics(), **losses}

    def loss(self, params, learner: Learner, actors: Actors, key):
        """Minus the mean objective of the environments of this device, and their experience."""
        policy = self.with_params(learner, params)

        def act(obs, key):
            action, log_prob = policy.distribution(obs).sample_and_log_prob(key)
            return self.scale(action), -log_prob

        actors, seen, episodes = collect(self.env, act, actors, key, self.config.horizon)
        returns = self.returns(learner, seen)
        objective = returns.mean()
        return -objective, lax.stop_gradient((actors, seen, returns, episodes))

    def returns(self, learner: Learner, seen: Experience) -> Float[Array, "T n"]:
        """Lambda-returns, with the values of the target critic."""
        over_envs = jax.vmap(lambda_returns, in_axes=(1,) * 4 + (None, None), out_axes=1)
        return over_envs(
            self.rewards(seen),
            self.values(learner, seen.next_obs),
            seen.terminated,
            seen.truncated,
            self.config.discount,
            self.config.decay,
        )

    def rewards(self, seen: Experience) -> Float[Array, "T n"]:
        """Rewards for the learner: scaled, plus the entropy bonus."""
        return self.config.reward_scale * seen.reward + self.config.entropy * seen.extras

    def values(self, learner: Learner, obs: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """Values of the target critic."""
        values: Any = self.value.apply(learner.target, self.normalize(learner, obs))
        return values

    def improve(self, learner: Learner, gradient, rate, obs: Float[Array, "T n obs"]) -> Learner:
        """One step of the policy, and of its average."""
        params, optimizer = self.adam.step(learner.policy, learner.policy_optimizer, gradient, rate)
        params = blend(learner.policy, params, self.step_length(learner, params, obs))
        mean = blend(learner.mean_policy, params, RECENT)
        improved = learner.replace(policy=params, mean_policy=mean, policy_optimizer=optimizer)
        return keep_finite((gradient, params), improved, learner)

    def step_length(self, learner: Learner, params, obs) -> Float[Array, ""]:
        """Part of the way to the new parameters at which the policy has moved by `max_kl` at most.

        The divergence grows with the square of the way.
        """
        old, new = (
            self.with_params(learner, p).distribution(obs) for p in (learner.policy, params)
        )
        moved = average(divergence(old, new).mean())
        return jnp.sqrt(self.config.max_kl / jnp.maximum(moved, self.config.max_kl))

    def fit(self, learner: Learner, obs: Float[Array, "T n obs"], targets, key, rate):
        """All gradient steps of the critic in an epoch; also returns their mean error."""
        data = jax.tree.map(
            lambda x: x.reshape(-1, *x.shape[2:]), (self.normalize(learner, obs), targets)
        )
        count = data[1].shape[0]
        order = minibatches(key, count, self.config.passes, self.config.minibatches)

        def body(learner, rows):
            obs, target = jax.tree.map(lambda x: x[rows], data)
            loss, gradient = average(
                jax.value_and_grad(self.value_loss)(learner.value, obs, target)
            )
            params, optimizer = self.adam.step(
                learner.value, learner.value_optimizer, gradient, rate
            )
            fitted = learner.replace(value=params, value_optimizer=optimizer)
            return keep_finite((loss, gradient), fitted, learner), loss

        learner, losses = lax.scan(body, learner, order)
        return learner, jnp.nanmean(losses)

    def value_loss(self, params, obs, target):
        """Mean squared error of the critic."""
        return jnp.square(self.value.apply(params, obs) - target).mean()


def lambda_returns(
    reward: Float[Array, "T"],
    next_value: Float[Array, "T"],
    terminated: Bool[Array, "T"],
    truncated: Bool[Array, "T"],
    discount: float,
    decay: float,
) -> Float[Array, "T"]:
    """Returns G_t of the steps of one environment, cut softly (Sutton & Barto 2018, eq. 12.18).

    G_t = r_t + discount ((1 - decay) V(s'_t) + decay G_{t+1})

    At the last step and at a truncation it is `r_t + discount V(s'_t)`, at a termination r_t.

    Args:
      reward: r_t.
      next_value: V(s'_t), the value of the state that step t led to, before a possible reset.
      terminated: the episode ended in s'_t.
      truncated: the episode was truncated at s'_t.
      discount: factor per step, gamma.
      decay: weight of longer returns, lambda.
    """
    value = jnp.where(terminated, 0, next_value)
    on = jnp.where(terminated | truncated, 0, decay).astype(value.dtype)

    def body(after, step):
        reward, value, on = step
        now = reward + discount * ((1 - on) * value + on * after)
        return now, now

    return lax.scan(body, value[-1], (reward, value, on), reverse=True)[1]
