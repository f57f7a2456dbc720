"""PPO: the objective, its safeguards, and that it learns."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jaxsim import envs
from jaxsim.parallel.devices import AXIS
from jaxsim.rl import config, ppo, train
from jaxsim.rl.config import ConfigError
from jaxsim.rl.ppo import PPO, Sample


@pytest.fixture
def learner_of(tiny):
    """Function from settings to (PPO, learner, samples drawn from its policy)."""

    def build(**changes):
        trainer = PPO(envs.AutoReset(envs.make("fast")), config.build(ppo.Config, tiny | changes))
        learner = trainer.init(jax.random.key(0))
        obs = jax.random.normal(jax.random.key(1), (64, 1))
        old = trainer.network.apply(learner.params["policy"], obs)
        action = old.sample(jax.random.key(2))
        log_prob, zero = old.log_prob(action), jnp.zeros(64)
        return trainer, learner, Sample(obs, action, old, log_prob, zero, zero)

    return build


def on_one_device(f):
    """Bind the axis of devices, with one of them."""
    return jax.jit(jax.vmap(f, in_axes=(None, 0), out_axes=0, axis_name=AXIS))


def test_gradient_at_the_old_policy_is_the_policy_gradient(learner_of):
    """There the ratio is 1, and the gradient that of -E[A log p]."""
    trainer, learner, samples = learner_of(value_weight=0.0)
    samples = samples.replace(advantage=jnp.sin(samples.obs[:, 0]))

    def plain(params):
        log_prob = trainer.network.apply(params["policy"], samples.obs).log_prob(samples.action)
        return -(samples.advantage * log_prob).mean()

    got = jax.grad(lambda p: trainer.loss(p, samples)[0])(learner.params)["policy"]
    expected = jax.grad(plain)(learner.params)["policy"]
    for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("advantage", [1.0, -1.0])
def test_clipping_takes_the_gain_from_going_too_far(learner_of, advantage):
    """Samples whose ratio is beyond the clip in the direction of their advantage do not pull."""
    trainer, learner, samples = learner_of(value_weight=0.0)
    beyond = samples.replace(
        log_prob=samples.log_prob - np.float32(np.log(1.5 if advantage > 0 else 0.5)),
        advantage=jnp.full(64, advantage),
    )
    gradient = jax.grad(lambda p: trainer.loss(p, beyond)[0])(learner.params)
    assert optax.tree.norm(gradient) == 0
    back = beyond.replace(advantage=-beyond.advantage)
    gradient = jax.grad(lambda p: trainer.loss(p, back)[0])(learner.params)
    assert optax.tree.norm(gradient) > 0


def test_value_is_fitted_to_its_targets(learner_of):
    trainer, learner, samples = learner_of()
    samples = samples.replace(target=3 * samples.obs[:, 0])
    loss, losses = trainer.loss(learner.params, samples)
    value = trainer.value.apply(learner.params["value"], samples.obs)
    np.testing.assert_allclose(losses["value_loss"], 0.5 * ((value - samples.target) ** 2).mean())
    np.testing.assert_allclose(loss, 0.5 * losses["value_loss"], rtol=1e-5)
    assert losses["kl"] == 0


def test_numbers_that_are_not_finite_do_not_reach_the_parameters(learner_of, bits):
    trainer, learner, samples = learner_of()
    batch = jax.tree.map(lambda x: x[None], samples)
    poisoned = batch.replace(advantage=batch.advantage.at[0, 3].set(jnp.nan))
    after, _ = on_one_device(trainer.update)(learner, poisoned)
    assert bits(jax.tree.map(lambda x: x[0], after)) == bits(learner)
    after, _ = on_one_device(trainer.update)(learner, batch.replace(target=batch.target + 1))
    assert bits(jax.tree.map(lambda x: x[0], after)) != bits(learner)


def test_step_size_follows_the_divergence(learner_of):
    trainer, _, _ = learner_of(schedule="kl", target_kl=0.01)
    rate = jnp.asarray(1e-3)
    np.testing.assert_allclose(trainer.next_rate(rate, 0.03), 1e-3 / 1.5, rtol=1e-6)
    np.testing.assert_allclose(trainer.next_rate(rate, 0.001), 1e-3 * 1.5, rtol=1e-6)
    np.testing.assert_allclose(trainer.next_rate(rate, 0.01), 1e-3, rtol=1e-6)
    assert learner_of(schedule="constant")[0].next_rate(rate, 9.0) is rate


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"envs": 7}, "envs must be a multiple of the 2 devices, got 7"),
        ({"minibatches": 7}, r"envs \* unroll on each device \(64\) must be a multiple of"),
        ({"schedule": "cosine"}, "schedule must be linear, constant or kl, got 'cosine'"),
    ],
)
def test_settings_that_make_no_sense(tiny, settings, message):
    with pytest.raises(ConfigError, match=message):
        train("fast", settings=tiny | settings)


@pytest.mark.parametrize("schedule", ["linear", "kl"])
def test_learns(tiny, schedule):
    """To stay in the middle earns 20, doing nothing about 13, leaving it much less."""
    settings = tiny | {
        "total_steps": 100 * 512,
        "envs": 32,
        "passes": 4,
        "learning_rate": 3e-3,
        "initial_std": 0.5,
        "evaluation_episodes": 32,
        "schedule": schedule,
    }
    result = train("fast", settings=settings)
    assert result.evaluations[-1]["eval_return"] > 18
    obs = jnp.array([[-0.8], [0.8]])
    assert (result.policy(obs) * obs < 0).all()
