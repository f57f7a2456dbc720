"""Batches in chunks: sizes that divide, and results in the order of the batch."""

import jax.numpy as jnp
import numpy as np
import pytest

import jaxsim
from jaxsim.batch.chunks import MIN_LANES, chunk_lanes, even_lanes, map_chunks


@pytest.fixture(scope="module")
def model():
    return jaxsim.load("pendulum")


@pytest.mark.parametrize(("count", "lanes"), [(8, 8), (512, 256), (300, 150), (257, 257)])
def test_even_lanes(model, count, lanes):
    assert even_lanes(model, count) == lanes


def test_large_models_come_in_small_chunks():
    assert chunk_lanes(jaxsim.load("chain")) >= MIN_LANES


def test_map_chunks():
    x, words = jnp.arange(12.0), {"a": jnp.arange(24.0).reshape(12, 2)}
    seen = []

    def f(x, words):
        seen.append(x.shape)
        return x * 2, words["a"].sum(axis=1)

    for lanes in (12, 4, 1):
        twice, sums = map_chunks(f, lanes, x, words)
        np.testing.assert_array_equal(twice, 2 * x)
        np.testing.assert_array_equal(sums, words["a"].sum(axis=1))
        assert seen[-1] == (lanes,)
