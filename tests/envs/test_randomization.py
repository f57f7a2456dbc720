"""Domain randomisation: nothing is mutated, constants follow, batches of environments step."""

import jax
import jax.numpy as jnp
import numpy as np
from oracle import quick_jit

import jaxsim
from jaxsim.envs import make, randomize
from jaxsim.io import set_const


def test_factors_are_within_their_ranges(key):
    env = make("cartpole")
    nominal = env.model
    model = quick_jit(randomize)(env, key).model
    ratio = model.body_mass[1:] / nominal.body_mass[1:]
    assert jnp.all((ratio > 0.8) & (ratio < 1.2))
    assert ratio[0] != ratio[1]
    np.testing.assert_allclose(
        model.body_inertia[1:] / nominal.body_inertia[1:],
        np.repeat(ratio[:, None], 3, axis=1),
        rtol=1e-5,
    )
    assert 0.9 < model.actuator_gear[0, 0] / nominal.actuator_gear[0, 0] < 1.1
    np.testing.assert_allclose(
        model.dof_invweight0, quick_jit(set_const)(model).dof_invweight0, rtol=1e-5
    )
    assert env.model is nominal
    np.testing.assert_array_equal(nominal.body_mass, make("cartpole").model.body_mass)


def test_a_batch_of_environments(key):
    keys = jax.random.split(key, 4)

    @quick_jit
    def run(keys):
        envs = jaxsim.vmap(randomize, in_axes=(None, 0))(make("cartpole"), keys)
        states = jaxsim.vmap(lambda env: env.reset(key))(envs)
        return jaxsim.vmap(lambda env, state: env.step(state, jnp.ones(1)))(envs, states)

    velocity = run(keys).state.qvel[:, 0]
    assert len(np.unique(velocity)) == 4


def test_ranges_can_be_left_out(key):
    env = make("fast")
    same = randomize(env, key, mass=None, friction=None, damping=None, strength=None)
    assert all(a is b for a, b in zip(jax.tree.leaves(env), jax.tree.leaves(same), strict=True))
