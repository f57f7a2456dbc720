"""What tests of trainers share: tiny settings on the trivial environment."""

import dataclasses

import jax
import pytest

from jaxsim.rl import driver


@pytest.fixture(scope="session")
def tiny() -> dict:
    """Settings of PPO with four epochs of 128 steps, evaluated after the second and the last."""
    return {
        "total_steps": 4 * 128,
        "envs": 8,
        "unroll": 16,
        "minibatches": 2,
        "passes": 2,
        "evaluations": 2,
        "evaluation_episodes": 4,
        "evaluation_steps": 7,  # for tasks without a limit: `fast` has one of 20 steps
        "policy": {"hidden": [8]},
        "value": {"hidden": [8]},
    }


_PROGRAMS: dict = {}


@pytest.fixture
def compiled_once(monkeypatch):
    """Trainings of one kind share their compiled programs."""
    compile_all = driver.compile_all

    def remembered(env, algorithm, seed, mesh, start):
        config = dataclasses.replace(algorithm.config, target=None)
        key = (jax.tree.structure(env), type(algorithm), repr(config), seed, mesh)
        if key not in _PROGRAMS:
            _PROGRAMS[key] = compile_all(env, algorithm, seed, mesh, start)
        return _PROGRAMS[key]

    monkeypatch.setattr(driver, "compile_all", remembered)


@pytest.fixture
def bits():
    """Function from a tree to the bytes of its leaves, to compare bit by bit."""

    def plain(x):
        if jax.dtypes.issubdtype(x.dtype, jax.dtypes.prng_key):
            x = jax.random.key_data(x)
        return jax.device_get(x).tobytes()

    return lambda tree: [plain(x) for x in jax.tree.leaves(tree)]
