"""One compilation per structure; `jit`, `vmap`, `grad`, `jvp` and `scan` in any order."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import assert_close, quick_jit
from random_models import from_parents, random_model, random_states

from jaxsim.dynamics.aba import forward_dynamics
from jaxsim.dynamics.crba import mass_matrix
from jaxsim.dynamics.rnea import inverse_dynamics
from jaxsim.io import load
from jaxsim.joints.coordinates import integrate_pos


@pytest.fixture(scope="module")
def small():
    """A small tree with every joint type, ours and MuJoCo's, and two states."""
    with jax.enable_x64(True):
        mj = mujoco.MjModel.from_xml_string(random_model(1, bodies=4, multiple=False))
        yield mj, load(mj), *random_states(mj, seed=0, n=2)


def test_models_that_differ_in_numbers_share_one_compilation(small):
    mj, model, qpos, qvel = small
    heavier = load(_scaled(mj))
    traces = []

    @quick_jit
    def accelerations(model, qpos, qvel):
        traces.append(1)
        return forward_dynamics(model, qpos, qvel, 0 * qvel)

    first = accelerations(model, qpos[0], qvel[0])
    second = accelerations(heavier, qpos[0], qvel[0])
    assert len(traces) == 1
    assert model.structure == heavier.structure
    assert hash(model.structure) == hash(heavier.structure)
    assert np.abs(first - second).max() > 1e-3


def test_models_that_differ_in_structure_are_different():
    one, other = load(random_model(1, bodies=3)), load(random_model(1, bodies=4))
    assert one.structure != other.structure
    assert one.structure != "a structure"


def test_vmap_over_models_is_a_loop_over_models(small):
    mj, model, qpos, qvel = small
    models = jax.tree.map(lambda *x: jnp.stack(x), model, load(_scaled(mj)))
    f = jax.vmap(lambda m, q, v: forward_dynamics(m, q, v, 0 * v))
    together = quick_jit(f)(models, qpos, qvel)
    one = quick_jit(forward_dynamics)
    for i in range(2):
        alone = one(jax.tree.map(lambda x, i=i: x[i], models), qpos[i], qvel[i], 0 * qvel[i])
        assert_close(together[i][None], alone[None], 1e-10, 1e-10)


def test_vmap_over_one_parameter(small):
    _, model, qpos, _ = small
    masses = model.body_mass[None] * jnp.array([0.5, 1.0, 2.0])[:, None]
    f = jax.vmap(lambda mass: mass_matrix(model.replace(body_mass=mass), qpos[0]))
    light, usual, heavy = quick_jit(f)(masses)
    # The mass matrix is affine in the masses.
    assert_close((heavy - usual)[None], 2 * (usual - light)[None], 1e-12, 1e-12)


def test_batch_of_one(small):
    _, model, qpos, qvel = small
    f = lambda q, v: inverse_dynamics(model, q, v, v)  # noqa: E731
    batched = quick_jit(jax.vmap(f))(qpos[:1], qvel[:1])
    assert_close(batched, quick_jit(f)(qpos[0], qvel[0])[None], 1e-12, 1e-12)


def test_derivatives_of_a_scanned_motion():
    mj = from_parents([-1, 0], ["free", "hinge"])
    model, (qpos, qvel) = load(mj), random_states(mj, seed=0, n=2)

    def step(state, _):
        q, v = state
        v = v + 0.01 * forward_dynamics(model, q, v, 0 * v)
        return (integrate_pos(model, q, v, 0.01), v), None

    def loss(v):
        (q, v), _ = jax.lax.scan(step, (jnp.asarray(qpos[0]), v), None, length=3)
        return q @ q + v @ v

    def both(v, d):
        return (
            jax.grad(loss)(v) @ d,
            jax.jvp(loss, (v,), (d,))[1],
            loss(v + 1e-5 * d),
            loss(v - 1e-5 * d),
        )

    reverse, forward, ahead, behind = quick_jit(both)(qvel[0], qvel[1])
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    np.testing.assert_allclose(forward, (ahead - behind) / 2e-5, rtol=1e-6)


def test_dtype_follows_the_inputs(small):
    mj, *_ = small
    with jax.enable_x64(False):
        model = load(mj)
        shapes = jax.eval_shape(forward_dynamics, model, model.qpos0, *(jnp.zeros(model.nv),) * 2)
    assert shapes.dtype == np.float32


def _scaled(mj):
    """The same structure with other masses, poses and gravity."""
    changed = mujoco.MjModel.from_xml_string(random_model(1, bodies=4, multiple=False))
    changed.body_mass *= 1.5
    changed.body_pos[1:] *= 1.1
    changed.opt.gravity[:] += 1
    return changed
