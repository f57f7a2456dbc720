"""No gradient of a step of a bundled model is NaN, at ten thousand random and singular states."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from oracle import quick_jit

import jaxsim
from jaxsim.io import bundled_models
from jaxsim.joints.coordinates import integrate_pos

EVALUATIONS, TOGETHER = 10_000, 500
LEAVES = ("body_mass", "geom_friction", "dof_damping")


def random_states(model, rng, n):
    """Positions, velocities and controls of every size, many of them with zeros and at limits.

    Displacements, velocities and controls each have a random size in an environment, zero
    included, and half of their components are zero in half of the environments. In a quarter all
    joints with limits are exactly at one of them.
    """

    def noise(width, sizes):
        size = rng.choice(sizes, (n, 1))
        some = (rng.random((n, width)) < 0.5) | (rng.random((n, 1)) < 0.5)
        return size * some * rng.normal(size=(n, width))

    start = jaxsim.make_state(model)
    moves = noise(model.nv, [0, 1e-12, 1e-4, 1e-2, 0.3, 2])
    integrate = jax.vmap(lambda move: integrate_pos(model, start.qpos, move, 1.0))
    qpos = np.array(integrate(jnp.asarray(moves, jnp.float32)))
    single = [j for j in range(model.njnt) if model.jnt_limited[j] and model.jnt_type[j] >= 2]
    where = np.array([model.jnt_qposadr[j] for j in single], int)
    ends = np.asarray(model.jnt_range)[single]
    at = np.flatnonzero(rng.random(n) < 0.25)
    side = rng.integers(0, 2, (len(at), len(single)))
    qpos[np.ix_(at, where)] = np.where(side, ends[:, 1], ends[:, 0])
    qvel = noise(model.nv, [0, 1e-12, 1e-3, 1, 30])
    return qpos, qvel, noise(model.nu, [0, 1e-12, 1, 100])


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_models())
def test_no_nan(name, rng):
    model = jaxsim.load(name)
    weight = jnp.asarray(rng.normal(size=model.nq + model.nv), jnp.float32)
    leaves = {name: getattr(model, name) for name in LEAVES}

    def loss(leaves, qpos, qvel, ctrl):
        state = jaxsim.make_state(model).replace(qpos=qpos, qvel=qvel)
        after = jaxsim.step(model.replace(**leaves), state, ctrl)
        return weight @ jnp.concatenate([after.qpos, after.qvel])

    def one(x):
        value, gradient = jax.value_and_grad(loss, range(4))(leaves, *x)
        largest = [jnp.max(jnp.abs(g), initial=0) for g in jax.tree.leaves(gradient)]
        return value, sum(largest)

    states = [jnp.asarray(x, jnp.float32) for x in random_states(model, rng, EVALUATIONS)]
    chunks = [x.reshape(EVALUATIONS // TOGETHER, TOGETHER, x.shape[1]) for x in states]
    found = quick_jit(lambda *x: lax.map(jaxsim.vmap(one), x))(*chunks)
    values, sizes = (np.asarray(x).ravel() for x in found)
    # An explicit integrator may leave the range of float32 within a step at such velocities.
    sane = np.abs(values) < 1e9
    assert sane.mean() > 0.95
    assert np.isfinite(sizes[sane]).all()
