"""Results that are kept for as long as what they were computed from."""

import gc
import weakref

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import struct

from jaxsim.arrays.memo import once_for_each
from jaxsim.parallel.devices import device_mesh, everywhere


@struct.dataclass
class Pair:
    a: object
    b: object


@pytest.fixture
def total():
    """A sum that counts how often it is computed."""
    calls = []

    @once_for_each
    def total(tree, scale):
        calls.append(1)
        return (tree.a + tree.b) * scale

    total.calls = calls
    return total


def test_computed_once_for_each_tree_and_argument(total):
    one, equal = (Pair(jnp.ones(2), 1.0) for _ in range(2))
    for _ in range(3):
        np.testing.assert_array_equal(total(one, 2), 4)
    assert len(total.calls) == 1
    np.testing.assert_array_equal(total(one, 3), 6)
    np.testing.assert_array_equal(total(equal, 2), 4)
    assert len(total.calls) == 3
    changed = one.replace(a=jnp.zeros(2))
    np.testing.assert_array_equal(total(changed, 2), 2)


def test_forgotten_with_the_tree():
    alive = []

    class Kept:
        pass

    @once_for_each
    def kept(tree):
        result = Kept()
        alive.append(weakref.ref(result))
        return result

    tree = Pair(jnp.ones(1), jnp.ones(1))
    kept(tree)
    gc.collect()
    assert alive[0]() is not None
    del tree
    gc.collect()
    assert alive[0]() is None


def test_arrays_that_may_change_are_read_each_time(total):
    numbers = np.ones(2)
    tree = Pair(numbers, jnp.ones(2))
    np.testing.assert_array_equal(total(tree, 1), 2)
    numbers[:] = 4
    np.testing.assert_array_equal(total(tree, 1), 5)


def test_traced_trees_are_not_remembered(total):
    double = jax.jit(lambda x: total(Pair(x, x), 1))
    np.testing.assert_array_equal(double(jnp.arange(3.0)), [0, 2, 4])
    np.testing.assert_array_equal(double(jnp.ones(3)), 2)
    np.testing.assert_array_equal(jax.grad(lambda x: total(Pair(x, x), 1).sum())(jnp.ones(3)), 2)


def test_what_is_traced_of_constants_is_not_remembered(total):
    tree = Pair(jnp.ones(2), 1.0)
    np.testing.assert_array_equal(jax.jit(lambda x: x * total(tree, 1))(jnp.arange(2.0)), [0, 2])
    np.testing.assert_array_equal(total(tree, 1), 2)


def test_everywhere_is_on_all_devices_and_the_same_each_time():
    mesh, tree = device_mesh(), Pair(jnp.arange(3.0), jnp.ones(()))
    placed = everywhere(tree, mesh)
    assert everywhere(tree, mesh) is placed
    assert placed.a.sharding.device_set == set(jax.devices())
    np.testing.assert_array_equal(placed.a, tree.a)
