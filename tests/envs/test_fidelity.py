"""Observations, rewards, terminations and starts are those of Gymnasium's v5 tasks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from fidelity import GYMNASIUM, divergence, nudged, ours, script, theirs, trace_ours, trace_theirs
from oracle import quick_jit

QUICK = ("half_cheetah", "hopper")
NAMES = [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in sorted(GYMNASIUM)]
STEPS = 100
ROUNDING = 3e-8  # of numbers of float32, on average


def _chaos(env, plan, expected, starts, noise=0.0):
    """How far MuJoCo gets from itself if started 1e-7 away, with noise in every step.

    The farthest of several starts, as few meet the contact that begins a step earlier or later.
    """
    others = [trace_theirs(env, nudged(plan, seed), noise, seed) for seed in range(starts)]
    apart = np.max([divergence(o, expected) for o in others], axis=0)
    return np.maximum.accumulate(np.maximum(1e-7, apart))


def _compare(env, reference, seed, noise=0.0):
    """Both traces, and how many times chaos explains their divergence, step by step.

    Once chaos has grown large, contacts begin at different steps and say no more: which steps are
    compared is judged without noise. Tasks end at the same time.
    """
    plan = script(reference, seed, STEPS)
    expected, found = trace_theirs(reference, plan), trace_ours(env, plan)
    error, chaos = divergence(found, expected), _chaos(reference, plan, expected, 3)
    assert np.isfinite(found.obs).all()
    known = chaos < 1e-3
    assert known.sum() >= 10
    sure = chaos < 1e-4
    np.testing.assert_array_equal(found.terminated[sure], expected.terminated[sure])
    explained = _chaos(reference, plan, expected, 30, noise) if noise else chaos
    return found, expected, (error / explained)[known]


@pytest.mark.parametrize("name", NAMES)
def test_the_same_in_float64(x64, name):
    """Exact while nothing is chaotic."""
    env, reference = ours(name), theirs(name, converged=True)
    for seed in range(3):
        found, expected, ratio = _compare(env, reference, seed)
        assert ratio.max() <= 1
        for x, y in ((found.obs, expected.obs), (found.reward, expected.reward)):
            scale = 1 + np.abs(y).max(0)
            np.testing.assert_allclose(x[:5] / scale, y[:5] / scale, atol=1e-11)


@pytest.mark.parametrize("name", NAMES)
def test_the_same_in_float32(name):
    """Against MuJoCo with its states rounded; a factor for the rounding of all that is computed."""
    env, reference = ours(name), theirs(name, converged=True)
    for seed in range(6):
        _, _, ratio = _compare(env, reference, seed, noise=ROUNDING)
        assert ratio.max() <= 20


@pytest.mark.slow
@pytest.mark.parametrize("name", ["humanoid", "humanoid_standup"])
def test_the_unfinished_solver_of_gymnasium_matters_little(x64, name):
    """Their 50 sweeps of PGS against the optimum."""
    env, reference = ours(name), theirs(name)
    plan = script(reference, 0, STEPS)
    expected, found = trace_theirs(reference, plan), trace_ours(env, plan)
    scale = np.abs(expected.reward).max()
    np.testing.assert_allclose(found.reward / scale, expected.reward / scale, atol=1e-3)
    np.testing.assert_array_equal(found.terminated, expected.terminated)


@pytest.mark.slow
def test_rotations_as_a_group_differ_by_the_third_power_of_the_time_step(x64):
    """Of the ant in the air; MuJoCo averages angular velocities."""
    env, reference = ours("ant", frame_skip=1), theirs("ant", frame_skip=1)
    env = env.with_model(env.model.replace(rotations="lie"))
    errors = []
    for h in (0.01, 0.005, 0.0025):
        opt = env.model.opt.replace(timestep=jnp.asarray(h))
        reference.model.opt.timestep = h
        plan = script(reference, 0, 1)
        plan = plan.replace(qpos=plan.qpos + 2.0 * np.eye(15)[2], qvel=20 * plan.qvel)
        found = trace_ours(env.with_model(env.model.replace(opt=opt)), plan)
        expected = trace_theirs(reference, plan)
        errors.append(np.abs(found.obs[1, :13] - expected.obs[1, :13]).max())
    assert errors[0] < 1e-4
    np.testing.assert_allclose(np.array(errors[:-1]) / errors[1:], 8, rtol=0.3)


OPTIONS = {
    "ant": {
        "exclude_current_positions_from_observation": False,
        "include_cfrc_ext_in_observation": False,
        "forward_reward_weight": 2.0,
        "ctrl_cost_weight": 0.3,
        "contact_cost_weight": 0.1,
        "healthy_reward": 3.0,
        "main_body": 4,
        "healthy_z_range": (0.5, 0.7),
        "contact_force_range": (-2.0, 3.0),
        "frame_skip": 2,
    },
    "half_cheetah": {
        "exclude_current_positions_from_observation": False,
        "forward_reward_weight": 2.0,
        "ctrl_cost_weight": 0.3,
        "frame_skip": 3,
    },
    "hopper": {
        "exclude_current_positions_from_observation": False,
        "terminate_when_unhealthy": False,
        "healthy_state_range": (-2.0, 1.5),
        "healthy_z_range": (1.2, 1.3),
        "healthy_angle_range": (-0.1, 0.1),
        "healthy_reward": 3.0,
    },
    "humanoid": {
        "exclude_current_positions_from_observation": False,
        "include_cvel_in_observation": False,
        "contact_cost_weight": 1e-4,
        "contact_cost_range": (0.5, 2.0),
        "healthy_z_range": (1.3, 2.0),
    },
    "humanoid_standup": {
        "include_cinert_in_observation": False,
        "include_qfrc_actuator_in_observation": False,
        "include_cfrc_ext_in_observation": False,
        "impact_cost_weight": 1e-4,
        "ctrl_cost_weight": 0.3,
    },
    "walker2d": {
        "healthy_z_range": (1.1, 1.3),
        "healthy_angle_range": (-0.05, 0.1),
        "healthy_reward": 3.0,
    },
}


@pytest.mark.parametrize(
    "name", [n if n == "hopper" else pytest.param(n, marks=pytest.mark.slow) for n in OPTIONS]
)
def test_options_mean_the_same(x64, name):
    options = OPTIONS[name]
    env = ours(name, **options)
    reference = theirs(name, converged=True, **options)
    plan = script(reference, 4, 30)
    expected, found = trace_theirs(reference, plan), trace_ours(env, plan)
    for x, y in ((found.obs, expected.obs), (found.reward, expected.reward)):
        scale = 1 + np.abs(y).max(0)
        np.testing.assert_allclose(x / scale, y / scale, atol=1e-7)
    np.testing.assert_array_equal(found.terminated, expected.terminated)


@pytest.mark.parametrize("name", sorted(GYMNASIUM))
def test_starts_are_distributed_as_theirs(name):
    """Quantiles of each position and velocity over many starts."""
    reference, env = theirs(name), ours(name)
    starts = []
    for seed in range(300):
        reference.reset(seed=seed)
        starts.append(np.concatenate([reference.data.qpos, reference.data.qvel]))
    state = quick_jit(jax.vmap(env.start))(jax.random.split(jax.random.key(0), 2000))
    found = np.concatenate([state.qpos, state.qvel], axis=1)
    nominal, starts = found.mean(0), np.array(starts)
    spread = starts.std(0)
    for q in (0.02, 0.25, 0.5, 0.75, 0.98):
        x, y = np.quantile(found, q, axis=0), np.quantile(starts, q, axis=0)
        assert (np.abs(x - y) <= 0.4 * spread + 1e-6).all(), (q, x - nominal, y - nominal)
