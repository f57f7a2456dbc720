"""SHAC: its gradient is that of its objective, its targets are right, and it learns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim import envs
from jaxsim.parallel.devices import AXIS
from jaxsim.rl import config, shac, train
from jaxsim.rl.config import ConfigError
from jaxsim.rl.networks import divergence
from jaxsim.rl.shac import SHAC, lambda_returns

TINY = {
    "envs": 4,
    "horizon": 6,
    "minibatches": 2,
    "evaluation_episodes": 4,
    "policy": {"hidden": [8]},
    "value": {"hidden": [8]},
}


def build(env, **changes):
    """SHAC with tiny settings, a learner, and environments."""
    trainer = SHAC(envs.AutoReset(env), config.build(shac.Config, TINY | changes))
    learner = jax.jit(trainer.init)(jax.random.key(0))
    keys = jax.random.split(jax.random.key(1), 4)
    return trainer, learner, jax.jit(trainer.start)(learner, keys)


@pytest.mark.parametrize("name", ["fast", pytest.param("pendulum", marks=pytest.mark.slow)])
def test_gradient_is_that_of_the_objective(x64, name):
    """Central differences in float64 agree, although episodes end within the horizon."""
    env = envs.make(name, max_episode_steps=4)
    trainer, learner, actors = build(env, entropy=0.1)
    wide = lambda tree: jax.tree.map(lambda x: x.astype(float), tree)  # noqa: E731
    learner = learner.replace(policy=wide(learner.policy), target=wide(learner.target))
    key = jax.random.key(2)
    compiled = jax.jit(jax.value_and_grad(lambda p: trainer.loss(p, learner, actors, key)[0]))
    found = compiled(learner.policy)[1]
    leaves, structure = jax.tree.flatten(learner.policy)
    for seed in range(3):
        keys = jax.random.split(jax.random.key(seed), len(leaves))
        way = [jax.random.normal(k, x.shape) for k, x in zip(keys, leaves, strict=True)]
        ends = [
            structure.unflatten([x + h * d for x, d in zip(leaves, way, strict=True)])
            for h in (1e-5, -1e-5)
        ]
        slope = sum(jnp.vdot(g, d) for g, d in zip(jax.tree.leaves(found), way, strict=True))
        difference = (compiled(ends[0])[0] - compiled(ends[1])[0]) / 2e-5
        np.testing.assert_allclose(slope, difference, rtol=1e-6, atol=1e-9)


NO, YES = False, True


@pytest.mark.parametrize(
    ("terminated", "truncated", "expected"),
    [
        # With lambda = .5 and discount .5: G = r + .25 V' + .25 G'. Last: 3 + .5 * 30.
        ([NO, NO, NO], [NO, NO, NO], [6.375, 11.5, 18.0]),
        # The task ends in the second step: nothing follows.
        ([NO, YES, NO], [NO, NO, NO], [4.0, 2.0, 18.0]),
        # The episode is cut there: the critic says what would follow. 2 + .5 * 20
        ([NO, NO, NO], [NO, YES, NO], [6.5, 12.0, 18.0]),
        # Both at once: it ends.
        ([NO, NO, YES], [NO, NO, YES], [5.4375, 7.75, 3.0]),
    ],
)
def test_returns_by_hand(terminated, truncated, expected):
    got = lambda_returns(
        jnp.array([1.0, 2.0, 3.0]),
        jnp.array([10.0, 20.0, 30.0]),
        jnp.array(terminated),
        jnp.array(truncated),
        0.5,
        0.5,
    )
    # G_0 = 1 + .25 * 10 + .25 G_1, and so on.
    np.testing.assert_allclose(got, expected)


def test_states_before_a_fall_are_judged():
    """The reward is constant until the last step, a fall; the values of the states are not."""
    slope = jax.grad(
        lambda x: lambda_returns(
            jnp.ones(3), x, jnp.array([NO, NO, YES]), jnp.zeros(3, bool), 0.9, 0.9
        ).sum()
    )(jnp.ones(3))
    assert (slope[:2] > 0).all()
    assert slope[2] == 0


OBS = jnp.linspace(-1, 1, 24)[:, None].reshape(6, 4, 1)


@pytest.fixture
def improved():
    """Function from a gradient and a rate to the learner before and after the step."""
    trainer, learner, _ = build(envs.make("fast"))
    improve = jax.vmap(lambda g, r: trainer.improve(learner, g, r, OBS), axis_name=AXIS)

    def step(gradient, rate):
        one = jax.tree.map(lambda x: x[None], (gradient, jnp.array(rate)))
        return trainer, learner, jax.tree.map(lambda x: x[0], improve(*one))

    return step, jax.tree.map(jnp.ones_like, learner.policy)


def test_poisoned_gradient_does_not_reach_the_policy(bits, improved):
    step, gradient = improved
    _, old, new = step(gradient, 0.1)
    assert bits(new) != bits(old)
    poisoned = jax.tree.map(lambda x: x.at[0].set(jnp.nan), gradient)
    _, old, new = step(poisoned, 0.1)
    assert bits(new) == bits(old)


def test_long_steps_are_shortened_and_the_average_follows(improved):
    """Ten times the rate goes as far, not a hundred times: the divergence is nearly quadratic."""
    step, gradient = improved

    def moved(rate):
        trainer, old, new = step(gradient, rate)
        p, q = (trainer.with_params(x, x.policy).distribution(OBS) for x in (old, new))
        return divergence(p, q).mean(), old, new

    far, old, new = moved(0.3)
    np.testing.assert_allclose(far, shac.Config().max_kl, rtol=0.4)
    np.testing.assert_allclose(moved(3.0)[0], far, rtol=0.4)
    assert moved(1e-4)[0] < 0.1 * far
    jax.tree.map(
        lambda mean, a, b: np.testing.assert_allclose(mean, a + 0.02 * (b - a), atol=1e-6),
        new.mean_policy,
        old.policy,
        new.policy,
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"envs": 7}, "envs must be a multiple of the 2 devices, got 7"),
        ({"minibatches": 5}, r"envs \* horizon on each device \(12\) must be a multiple of"),
        ({"momentum": 0.9}, "momentum must be 2 values, got 0.9"),
    ],
)
def test_settings_that_make_no_sense(settings, message):
    with pytest.raises(ConfigError, match=message):
        train("fast", "shac", settings=TINY | settings)


def test_learns():
    """To stay in the middle earns 20, doing nothing about 13, leaving it much less."""
    settings = TINY | {
        "total_steps": 100 * 96,
        "envs": 16,
        "evaluations": 1,
        "discount": 0.9,
        "policy_rate": 5e-3,
        "value_rate": 3e-3,
        "reward_scale": 0.1,
    }
    result = train("fast", "shac", settings=settings)
    assert result.evaluations[-1]["eval_return"] > 18
    obs = jnp.array([[-0.8], [0.8]])
    assert (result.policy(obs) * obs < 0).all()
