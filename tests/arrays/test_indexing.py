"""Rows and sums by an index: the same numbers whether it is known early or only at run time."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.arrays.indexing import gather, gather_or_zero, sum_by, take

INDICES = [
    [],
    [0],
    [3, 3, 3],
    [0, 1, 2, 3, 4],
    [2, 3, 4],
    [4, 3, 2, 1, 0],
    [0, 2, 3, 1],
    list(range(5)) * 9,
]
X = np.arange(10.0).reshape(5, 2)


@pytest.mark.parametrize("index", INDICES)
def test_take_and_gather_are_indexing(index):
    index = np.array(index, int)
    for known in (take(jnp.asarray(X), index), gather(jnp.asarray(X), index)):
        np.testing.assert_array_equal(known, X[index])
    np.testing.assert_array_equal(gather(X, jnp.asarray(index)), X[index])


def test_known_rows_of_known_numbers_are_known():
    found = gather(np.arange(4), np.array([2, 0]))
    assert isinstance(found, np.ndarray)
    np.testing.assert_array_equal(found, [2, 0])


@pytest.mark.parametrize("index", [*INDICES, [-1, 2, -1], [-1]])
@pytest.mark.parametrize("rows", [5, 0])
def test_minus_one_is_zero(index, rows):
    index = np.where(np.array(index, int) < rows, np.array(index, int), -1)
    expected = np.concatenate([X[:rows], np.zeros((1, 2))])[index]
    for known_or_not in (index, jnp.asarray(index)):
        found = gather_or_zero(jnp.asarray(X[:rows]), known_or_not)
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(
    ("group", "n"),
    [([], 3), ([0, 1, 2], 3), ([0, 0, 1, 1], 2), ([2, 0, 2, 0, 2], 4), ([1] * 12, 3), ([1, 0], 2)],
)
def test_sum_by_is_a_scatter(group, n, rng):
    x, group = rng.normal(size=(len(group), 2)).astype(np.float32), np.array(group, int)
    expected = np.zeros((n, 2))
    np.add.at(expected, group, x)
    np.testing.assert_allclose(sum_by(jnp.asarray(x), group, n), expected, atol=1e-5)
    at_run_time = jax.jit(sum_by, static_argnums=2)(x, jnp.asarray(group), n)
    np.testing.assert_allclose(at_run_time, expected, atol=1e-5)
