"""Rollouts of batches alone and within programs: the same values, and derivatives of them."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export
from oracle import quick_jit

import jaxsim
from jaxsim.parallel.devices import device_mesh, split
from jaxsim.parallel.rollout import _compiled

BATCH, STEPS = 70, 3  # fills neither devices nor chunks evenly


@pytest.fixture(scope="module")
def scene():
    model = jaxsim.load("pendulum")
    keys = jax.random.split(jax.random.key(0), 2)
    qpos = jax.random.uniform(keys[0], (BATCH, model.nq), minval=-1, maxval=1)
    states = jax.vmap(lambda q: jaxsim.make_state(model).replace(qpos=q))(qpos)
    return model, states, jax.random.normal(keys[1], (BATCH, STEPS, model.nu))


def _expected(model, states, ctrls):
    return jax.vmap(lambda state, ctrl: jaxsim.rollout(model, state, ctrl))(states, ctrls)


def test_values(scene):
    final, qpos = jaxsim.batch_rollout(*scene, observe=lambda state: state.qpos)
    expected, path = _expected(*scene)
    np.testing.assert_allclose(final.qvel, expected.qvel, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(qpos, path.qpos, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("traced", ["all", "nothing"])
def test_within_jit(scene, traced):
    model, states, ctrls = scene
    if traced == "all":
        final = jax.jit(jaxsim.batch_rollout)(model, states, ctrls)
    else:
        final = jax.jit(lambda: jaxsim.batch_rollout(model, states, ctrls))()
    np.testing.assert_allclose(final.qvel, _expected(*scene)[0].qvel, rtol=1e-5, atol=1e-6)


def test_derivatives(scene):
    """Forward mode, also in parameters of the model, as that of `rollout`; and reverse mode."""
    model, states, ctrls = scene

    def loss(rollout, mass, ctrls):
        return jnp.sum(rollout(model.replace(body_mass=mass), states, ctrls).qvel ** 2)

    ours = functools.partial(loss, jaxsim.batch_rollout)
    theirs = functools.partial(loss, lambda *args: _expected(*args)[0])
    at = model.body_mass, ctrls
    tangent = jnp.ones_like(at[0]), jax.random.normal(jax.random.key(1), ctrls.shape)
    found, expected = (
        jax.jit(functools.partial(jax.jvp, f))(at, tangent)[1] for f in (ours, theirs)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    gradient = jax.jit(jax.grad(ours, argnums=(0, 1)))(*at)
    along = sum(jnp.vdot(x, t) for x, t in zip(gradient, tangent, strict=True))
    np.testing.assert_allclose(along, expected, rtol=1e-4)


def test_batches_of_batches(scene):
    model, states, ctrls = scene
    twice = jax.tree.map(lambda x: jnp.stack([x, x[::-1]]), (states, ctrls))
    final = jax.vmap(lambda s, c: jaxsim.batch_rollout(model, s, c))(*twice)
    expected = _expected(*scene)[0].qvel
    np.testing.assert_allclose(final.qvel[0], expected, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(final.qvel[1], expected[::-1], rtol=1e-5, atol=1e-6)


def test_split():
    """Every device has its rows, from arrays of JAX and of NumPy."""
    mesh = device_mesh(jax.local_devices())
    rows = np.arange(6.0 * mesh.size).reshape(-1, 3)
    given = {"numpy": rows, "jax": jnp.asarray(rows), "empty": jnp.zeros((len(rows), 0))}
    cut = jax.block_until_ready(split(given, mesh))
    for name in "numpy", "jax":
        np.testing.assert_array_equal(cut[name], rows)
    assert cut["empty"].shape == (len(rows), 0)
    for x in jax.tree.leaves(cut):
        assert [shard.data.shape[0] for shard in x.addressable_shards] == [2] * mesh.size
    again = split(cut, mesh)
    np.testing.assert_array_equal(again["jax"], rows)


def test_a_program_serves_all_models_of_a_structure(scene):
    """Only leaves that facts depend on are part of the program; others are its arguments."""
    model, states, ctrls = scene
    jaxsim.batch_rollout(model, states, ctrls)
    programs = _compiled.cache_info().misses
    heavier = model.replace(body_mass=2 * model.body_mass, body_inertia=2 * model.body_inertia)
    found = jaxsim.batch_rollout(heavier, states, ctrls).qvel
    assert _compiled.cache_info().misses == programs
    np.testing.assert_allclose(
        found, _expected(heavier, states, ctrls)[0].qvel, rtol=1e-5, atol=1e-6
    )
    turned = model.replace(jnt_axis=-model.jnt_axis)
    found = jaxsim.batch_rollout(turned, states, ctrls).qvel
    assert _compiled.cache_info().misses == programs + 1
    np.testing.assert_allclose(
        found, _expected(turned, states, ctrls)[0].qvel, rtol=1e-5, atol=1e-6
    )


def _for_gpus(f, ctrls):
    """The program for CUDA, in which nothing is that only other devices have."""
    unchecked = [export.DisabledSafetyCheck.platform()]  # it will be run on a CPU
    program = export.export(jax.jit(f), platforms=["cuda"], disabled_checks=unchecked)(ctrls)
    text = program.mlir_module()
    assert not [word for word in ("lapack", "xla_cpu", "inlineable") if word in text]
    return program.call


@pytest.mark.parametrize("quantity", ["rollout", pytest.param("gradient", marks=pytest.mark.slow)])
def test_programs_for_gpus(quantity):
    """The programs for CUDA, run on a CPU, give what those for a CPU give, up to rounding."""
    model = jaxsim.load("half_cheetah")
    states = jax.tree.map(lambda x: jnp.stack([x, x]), jaxsim.make_state(model))
    rollout = lambda ctrls: jaxsim.batch_rollout(model, states, ctrls)  # noqa: E731
    loss = lambda ctrls: jnp.sum(rollout(ctrls).qpos ** 2)  # noqa: E731
    f = rollout if quantity == "rollout" else jax.grad(loss)
    ctrls = jax.random.normal(jax.random.key(0), (2, 10, model.nu))
    found, expected = quick_jit(_for_gpus(f, ctrls))(ctrls), quick_jit(f)(ctrls)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        scale = jnp.max(jnp.abs(b), initial=1e-3)
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-3 * scale)


def test_gradients_lower_for_gpus(scene):
    model, states, ctrls = scene
    _for_gpus(jax.grad(lambda u: jnp.sum(jaxsim.batch_rollout(model, states, u).qpos)), ctrls)
