"""Observations, rewards, terminations and starts are those of Gymnasium's v5 tasks."""

import jax
import numpy as np
import pytest
from fidelity import GYMNASIUM, divergence, nudged, ours, script, theirs, trace_ours, trace_theirs

import jaxsim

QUICK = tuple(GYMNASIUM)
# Their Runge-Kutta averages angular velocities, ours does not; see the tasks' docstrings.
FREE = ("ant", "humanoid", "humanoid_standup")
NAMES = [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in sorted(GYMNASIUM)]
STEPS = 100


def _chaos(env, plan, expected):
    """How far MuJoCo gets from itself if started 1e-7 away."""
    others = [trace_theirs(env, nudged(plan, seed)) for seed in range(3)]
    return np.maximum(1e-7, np.max([divergence(o, expected) for o in others], axis=0))


def _compare(env, reference, seed, factor):
    """Divergence is no more than chaos; the task ends at the same time unless chaos hides when."""
    plan = script(reference, seed, STEPS)
    expected, found = trace_theirs(reference, plan), trace_ours(env, plan)
    error, chaos = divergence(found, expected), _chaos(reference, plan, expected)
    assert np.isfinite(found.obs).all()
    assert (error <= factor * chaos).all(), (error / chaos).max()
    known = chaos < 1e-3
    np.testing.assert_array_equal(found.terminated[known], expected.terminated[known])
    return found, expected


@pytest.mark.parametrize("name", NAMES)
def test_the_same_in_float64(x64, name):
    """Exact while nothing is chaotic."""
    euler = name in FREE
    env, reference = ours(name, euler=euler), theirs(name, euler=euler, converged=True)
    for seed in range(3):
        found, expected = _compare(env, reference, seed, 1)
        for x, y in ((found.obs, expected.obs), (found.reward, expected.reward)):
            scale = 1 + np.abs(y).max(0)
            np.testing.assert_allclose(x[:5] / scale, y[:5] / scale, atol=1e-11)


@pytest.mark.parametrize("name", NAMES)
def test_the_same_in_float32(name):
    """The reference is Gymnasium's as it is, humanoids with their unfinished solver included."""
    euler = name in FREE
    env, reference = ours(name, euler=euler), theirs(name, euler=euler)
    for seed in range(3):
        _compare(env, reference, seed, 100)
