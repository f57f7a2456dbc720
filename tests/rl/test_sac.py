"""SAC: targets, buffer and losses by hand, and that it learns."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim import envs
from jaxsim.rl import config, sac, train
from jaxsim.rl.config import ConfigError
from jaxsim.rl.parts.collect import Experience
from jaxsim.rl.sac import SAC, Transition, soft_target

TINY = {
    "envs": 4,
    "batch": 32,
    "capacity": 4096,
    "warmup": 64,
    "evaluation_episodes": 4,
    "policy": {"hidden": [16]},
    "value": {"hidden": [16]},
}


def build(**changes):
    """SAC on `fast` and a learner, as on one device."""
    trainer = SAC(envs.AutoReset(envs.make("fast")), config.build(sac.Config, TINY | changes), 1)
    return trainer, jax.jit(trainer.init)(jax.random.key(0))


def batch_of(n: int) -> Transition:
    """Made-up steps."""
    x = jnp.linspace(-1, 1, n)[:, None]
    return Transition(x, x, x[:, 0], x + 0.1, jnp.arange(n) % 3 == 0)


@pytest.mark.parametrize(("terminated", "expected"), [(False, 1 + 0.9 * (5 + 0.2 * 3)), (True, 1)])
def test_target_by_hand(terminated, expected):
    one = jnp.ones(())
    got = soft_target(one, 5 * one, -3 * one, jnp.array(terminated), 0.2 * one, 0.9)
    np.testing.assert_allclose(got, expected, rtol=1e-6)


def test_buffer_replaces_the_oldest_steps():
    trainer, _ = build(capacity=12, unroll=1)
    buffer = jax.tree.map(lambda x: jnp.zeros((12, *x.shape[1:]), x.dtype), batch_of(1))

    def seen(value):
        number = jnp.full((1, 4), float(value))
        row, no = number[..., None], jnp.zeros((1, 4), bool)
        return Experience(row, row, row, number, row, no, no)

    for epoch in range(4):
        buffer = trainer.remember(buffer, seen(epoch + 1), jnp.asarray(epoch))
    np.testing.assert_array_equal(buffer.reward, np.repeat([4.0, 2.0, 3.0], 4))
    np.testing.assert_array_equal(buffer.next_obs[:, 0], buffer.reward)


def error_of(trainer, learner, critics, batch, key):
    """Half the squared errors of both critics against targets that stand still."""
    action, log_prob = trainer.network.apply(
        learner.params["policy"], batch.next_obs
    ).sample_and_log_prob(jax.random.split(key)[1])
    next_value = jnp.minimum(*trainer.critics.apply(learner.target, batch.next_obs, action))
    worth = next_value - trainer.config.initial_temperature * log_prob
    target = batch.reward + trainer.config.discount * worth * ~batch.terminated
    values = trainer.critics.apply(critics, batch.obs, batch.action)
    return sum(0.5 * ((value - target) ** 2).mean() for value in values)


def test_each_loss_moves_its_own_parameters():
    """The critics' gradient is that of their squared error; the temperature's, of its own loss."""
    trainer, learner = build(entropy=-0.5)
    batch, key = batch_of(16), jax.random.key(3)
    gradient, losses = jax.jit(jax.grad(trainer.loss, has_aux=True))(
        learner.params, learner, batch, key
    )
    np.testing.assert_allclose(gradient["temperature"], losses["entropy"] + 0.5, rtol=1e-5)

    expected = jax.grad(lambda critics: error_of(trainer, learner, critics, batch, key))
    expected = expected(learner.params["critics"])
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, rtol=1e-4, atol=1e-6),
        gradient["critics"],
        expected,
    )


def test_policy_climbs_the_critics(monkeypatch):
    """With critics that say Q(s, a) = 3 a, the policy's mean action must rise."""
    trainer, learner = build()
    monkeypatch.setattr(
        type(trainer.critics), "apply", lambda self, p, obs, action: (3 * action[:, 0],) * 2
    )
    loss = lambda p: trainer.loss(p, learner, batch_of(16), jax.random.key(0))[0]  # noqa: E731
    gradient = jax.grad(loss)(learner.params)["policy"]["params"]["MLP_0"]["Dense_1"]["bias"]
    assert gradient[0] < 0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"envs": 7}, "envs must be a multiple of the 2 devices, got 7"),
        ({"batch": 5}, "batch must be a multiple of the 2 devices, got 5"),
        ({"capacity": 4098}, r"capacity must be a multiple of envs \* unroll \(4\), got 4098"),
    ],
)
def test_settings_that_make_no_sense(settings, message):
    with pytest.raises(ConfigError, match=message):
        train("fast", "sac", settings=TINY | settings)


def test_learns():
    """To stay in the middle earns 20, doing nothing about 13, leaving it much less."""
    settings = TINY | {
        "total_steps": 4000,
        "envs": 8,
        "updates": 4,
        "evaluations": 1,
        "learning_rate": 3e-3,
        "discount": 0.9,
        "follow": 0.05,
    }
    result = train("fast", "sac", settings=settings)
    assert result.evaluations[-1]["eval_return"] > 18
    obs = jnp.array([[-0.8], [0.8]])
    assert (result.policy(obs) * obs < 0).all()
