"""Short-horizon actor-critic (Xu et al. 2022): policy gradients through the simulation.

One epoch: every environment takes `horizon` steps with the present policy; the gradient of the
discounted rewards, plus the value that the critic sees at the end, flows back through policy and
physics into the policy's parameters. A short horizon keeps the gradient tame, the critic makes up
for what comes later. Then the critic is fitted to TD(lambda) targets of the same steps, for which
a slowly following copy of it, the target critic, gives the values. All of it is one compiled
program, in which each device works on its own environments and gradients are averaged.
"""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import optax
from flax import struct
from jax import lax
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Bool, Float

from jaxsim.envs import Env
from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.collect import Actors, Experience, collect, start_actors
from jaxsim.rl.config import ConfigError, NetworkConfig, TrainConfig
from jaxsim.rl.differentiable import (
    NO_LIMIT,
    Differentiable,
    cut_episodes,
    discounts,
    spread_episodes,
)
from jaxsim.rl.distributed import AXIS
from jaxsim.rl.gae import advantages
from jaxsim.rl.networks import ActionRange, Policy, TanhGaussianPolicy, Value
from jaxsim.rl.normalize import RunningStatistics

NETWORK = NetworkConfig(activation="elu")


@dataclasses.dataclass(frozen=True)
class Config(TrainConfig):
    """Settings of SHAC.

    Attributes:
      horizon: steps of each environment in one epoch, through which gradients flow.
      episode_steps: training cuts episodes after this many steps, so that starts are seen more
        often; the critic stands for the rest. None for the length that the task has.
      discount: factor per step of the return.
      decay: lambda of the value targets: 1 trusts returns, 0 the target critic.
      follow: part of the way to the critic that the target critic goes in one epoch.
      minibatches: gradient steps of the critic in one pass over the data of an epoch.
      passes: how often the critic is fitted to the data of an epoch.
      policy_rate: step size of Adam for the policy at the start; decreases to zero.
      value_rate: the same for the critic.
      momentum: Adam's averaging of gradients and of their squares, for both.
      max_grad_norm: longer gradients are scaled down to this norm.
      max_step_gradient: longer gradients of one environment with respect to the state and
        action of one step are scaled down to this norm.
      normalize_obs: subtract the running mean of the observations, divide by their deviation.
      reward_scale: factor on the rewards that the learner sees.
      entropy: worth of a nat of the policy's entropy in each step, after scaling.
      policy: network of the policy.
      value: network of the critic.
    """

    envs: int = 128
    horizon: int = 32
    episode_steps: int | None = None
    discount: float = 0.99
    decay: float = 0.95
    follow: float = 0.8
    minibatches: int = 4
    passes: int = 4
    policy_rate: float = 2e-3
    value_rate: float = 1e-3
    momentum: tuple[float, ...] = (0.7, 0.95)
    max_grad_norm: float = 1.0
    max_step_gradient: float = NO_LIMIT
    normalize_obs: bool = True
    reward_scale: float = 1.0
    entropy: float = 0.0
    policy: NetworkConfig = NETWORK
    value: NetworkConfig = NETWORK


@struct.dataclass
class Learner:
    """What SHAC learns; the same on all devices.

    Attributes:
      policy: parameters of the policy.
      value: parameters of the critic.
      target: parameters of the target critic.
      policy_optimizer: state of Adam.
      value_optimizer: state of Adam.
      obs: statistics of the observations.
      key: random numbers of the epochs to come.
      epoch: epochs so far.
    """

    policy: Any
    value: Any
    target: Any
    policy_optimizer: optax.OptState
    value_optimizer: optax.OptState
    obs: RunningStatistics
    key: Any
    epoch: Any


def make(env: Env, config: Config, devices: int) -> Algorithm:
    """SHAC on an environment (with `AutoReset`), on this many devices."""
    _check(config, devices)
    shac = SHAC(env, config)
    return Algorithm(
        config=config,
        init=shac.init,
        start=shac.start,
        epoch=shac.epoch,
        policy=shac.policy,
        steps_per_epoch=config.envs * config.horizon,
    )


class SHAC:
    """The algorithm as functions for one device, with its environment, settings and networks."""

    def __init__(self, env: Env, config: Config):
        self.env = Differentiable(cut_episodes(env, config.episode_steps), config.max_step_gradient)
        self.config = config
        self.scale = ActionRange.of(env)
        self.network = TanhGaussianPolicy(
            env.action_size, config.policy.hidden, config.policy.activation
        )
        self.value = Value(config.value.hidden, config.value.activation)
        # Flattened, the update of all parameters is a few vector operations.
        self.adam = optax.flatten(
            optax.chain(
                optax.clip_by_global_norm(config.max_grad_norm),
                optax.scale_by_adam(config.momentum[0], config.momentum[1]),
            )
        )
        self.epochs = max(1, config.total_steps // (config.envs * config.horizon))

    def init(self, key) -> Learner:
        """Parameters before training."""
        key, policy_key, value_key = jax.random.split(key, 3)
        obs = jnp.zeros(self.env.observation_size)
        policy, value = self.network.init(policy_key, obs), self.value.init(value_key, obs)
        return Learner(
            policy=policy,
            value=value,
            # A copy: what the compiled epoch may overwrite must not be one array twice.
            target=jax.tree.map(jnp.copy, value),
            policy_optimizer=self.adam.init(policy),
            value_optimizer=self.adam.init(value),
            obs=RunningStatistics.start(obs.shape),
            key=key,
            epoch=jnp.zeros((), int),
        )

    def start(self, learner: Learner, keys) -> Actors:
        """Reset one environment for each key, and spread the ends of their episodes."""
        return spread_episodes(start_actors(self.env, keys), keys, self.config.episode_steps)

    def policy(self, learner: Learner) -> Policy:
        """The present policy."""
        statistics = learner.obs if self.config.normalize_obs else None
        return Policy(learner.policy, statistics, self.scale, self.network)

    def epoch(self, learner: Learner, actors: Actors):
        """Improve the policy by a rollout, then the critic by what was seen in it."""
        key, carry = jax.random.split(learner.key)
        key = jax.random.fold_in(key, lax.axis_index(AXIS))
        act_key, shuffle_key = jax.random.split(key)
        gradient, (actors, seen, episodes, objective) = jax.grad(self.loss, has_aux=True)(
            learner.policy, learner, actors, act_key
        )
        gradient, objective = _average((gradient, objective))
        norm = optax.tree.norm(gradient)
        rate = jnp.clip(1 - learner.epoch / self.epochs, 0.0, 1.0)
        learner = self.improve(learner, gradient, rate * self.config.policy_rate)
        learner, value_loss = self.fit(learner, seen, shuffle_key, rate * self.config.value_rate)
        learner = learner.replace(
            # From the next epoch on: within an epoch the policy must see one normalisation.
            obs=learner.obs.update(seen.obs.reshape(-1, seen.obs.shape[-1]), AXIS),
            target=_blend(learner.target, learner.value, self.config.follow),
            key=carry,
            epoch=learner.epoch + 1,
        )
        losses = {"objective": objective, "policy_gradient": norm, "value_loss": value_loss}
        return learner, actors, {**episodes.metrics(), **losses}

    def loss(self, params, learner: Learner, actors: Actors, key):
        """Minus the mean objective of the environments of this device, and what was seen."""
        policy = self.policy(learner.replace(policy=params))

        def act(obs, key):
            action, log_prob = policy.distribution(obs).sample_and_log_prob(key)
            return self.scale(action), -log_prob

        actors, seen, episodes = collect(self.env, act, actors, key, self.config.horizon)
        values = self.values(learner, seen.next_obs)
        objective = jax.vmap(horizon_objective, in_axes=(1, 1, 1, 1, None))(
            self.rewards(seen),
            values,
            seen.terminated,
            seen.truncated,
            self.config.discount,
        ).mean()
        return -objective, lax.stop_gradient((actors, seen, episodes, objective))

    def rewards(self, seen: Experience) -> Float[Array, "T n"]:
        """Rewards as the learner sees them: scaled, with a bonus for randomness."""
        return self.config.reward_scale * seen.reward + self.config.entropy * seen.extras

    def values(self, learner: Learner, obs: Float[Array, "*batch n"]) -> Float[Array, "*batch"]:
        """What the target critic says."""
        values: Any = self.value.apply(learner.target, self.normalize(learner, obs))
        return values

    def normalize(self, learner: Learner, obs: Float[Array, "*batch n"]):
        """Observations as the networks see them."""
        return learner.obs.normalize(obs) if self.config.normalize_obs else obs

    def improve(self, learner: Learner, gradient, rate) -> Learner:
        """One step of the policy."""
        step, optimizer = self.adam.update(gradient, learner.policy_optimizer)
        improved = learner.replace(
            policy=_descend(learner.policy, step, rate), policy_optimizer=optimizer
        )
        return _if_finite(gradient, improved, learner)

    def fit(self, learner: Learner, seen: Experience, key, rate):
        """All gradient steps of the critic in an epoch; also returns their mean error."""
        obs = self.normalize(learner, seen.obs)
        data = jax.tree.map(
            lambda x: x.reshape(-1, *x.shape[2:]), (obs, self.targets(learner, seen))
        )
        count = data[1].shape[0]
        keys = jax.random.split(key, self.config.passes)
        order = jax.vmap(lambda k: jnp.argsort(jax.random.bits(k, (count,))))(keys)
        order = order.reshape(self.config.passes * self.config.minibatches, -1)

        def body(learner, rows):
            obs, target = jax.tree.map(lambda x: x[rows], data)
            loss, gradient = _average(
                jax.value_and_grad(self.value_loss)(learner.value, obs, target)
            )
            step, optimizer = self.adam.update(gradient, learner.value_optimizer)
            fitted = learner.replace(
                value=_descend(learner.value, step, rate), value_optimizer=optimizer
            )
            return _if_finite((loss, gradient), fitted, learner), loss

        learner, losses = lax.scan(body, learner, order)
        return learner, jnp.nanmean(losses)

    def value_loss(self, params, obs, target):
        """Mean squared error of the critic."""
        return jnp.square(self.value.apply(params, obs) - target).mean()

    def targets(self, learner: Learner, seen: Experience) -> Float[Array, "T n"]:
        """TD(lambda) targets: the target critic's values plus generalised advantages."""
        values = self.values(learner, seen.obs)
        estimate = jax.vmap(advantages, in_axes=(1,) * 5 + (None, None), out_axes=1)
        return values + estimate(
            self.rewards(seen),
            values,
            self.values(learner, seen.next_obs),
            seen.terminated,
            seen.truncated,
            self.config.discount,
            self.config.decay,
        )


def horizon_objective(
    reward: Float[Array, "T"],
    next_value: Float[Array, "T"],
    terminated: Bool[Array, "T"],
    truncated: Bool[Array, "T"],
    discount: float,
) -> Float[Array, ""]:
    """What the policy maximises on one environment (Xu et al. 2022, eq. 5).

    sum_t w_t (r_t + discount b_t V(s'_t)),   b_t = 1 where the data, but not the task, ends

    w_t is the discount since the last start of an episode. The value enters where an episode
    was cut short and at the horizon; nothing follows a termination.

    Args:
      reward: r_t.
      next_value: V(s'_t), the value of the state that step t led to.
      terminated: the episode ended in s'_t.
      truncated: the episode was cut short at s'_t.
      discount: factor per step.
    """
    last = jnp.arange(len(reward)) == len(reward) - 1
    bootstrap = (truncated | last) & ~terminated
    weight = discounts(terminated | truncated, discount).astype(reward.dtype)
    return jnp.sum(weight * (reward + discount * jnp.where(bootstrap, next_value, 0)))


def _average(tree):
    """Mean over all devices; one collective, as each of them costs a rendezvous."""
    flat, unravel = ravel_pytree(tree)
    return unravel(lax.pmean(flat, AXIS))


def _descend(params, step, rate):
    return jax.tree.map(lambda p, s: p - (rate * s).astype(p.dtype), params, step)


def _if_finite(watched, new, old):
    """The new values, unless one of the watched numbers is not finite."""
    fine = jnp.isfinite(ravel_pytree(watched)[0]).all()
    return jax.tree.map(lambda a, b: jnp.where(fine, a, b), new, old)


def _blend(old, new, part: float):
    return jax.tree.map(lambda a, b: a + part * (b - a), old, new)


def _check(config: Config, devices: int) -> None:
    """Sizes must divide; said before anything is compiled."""
    if config.envs % devices:
        raise ConfigError(f"envs must be a multiple of the {devices} devices, got {config.envs}")
    samples = config.envs // devices * config.horizon
    if samples % config.minibatches:
        raise ConfigError(
            f"envs * horizon on each device ({samples}) must be a multiple of minibatches "
            f"({config.minibatches})"
        )
    if len(config.momentum) != 2:
        raise ConfigError(f"momentum must be two numbers, got {config.momentum}")
