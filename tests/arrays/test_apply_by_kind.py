"""Functions by kind, of elements with one row or several."""

import jax.numpy as jnp
import numpy as np

from jaxsim.arrays.kinds import Rows, apply_by_kind

# Elements 0 and 2 have two rows, 1 and 3 have one.
KIND = np.array([5, 1, 5, 1])
START, SIZE = np.array([4, 3, 0, 2]), np.array([2, 1, 2, 1])


def test_each_element_goes_through_the_function_of_its_kind():
    x = jnp.array([1.0, 2.0, 3.0, 4.0])
    found = apply_by_kind(KIND, {5: lambda x: -x, 1: lambda x: 10 * x}, x, empty=x)
    np.testing.assert_array_equal(found, [-1, 20, -3, 40])


def test_blocks_of_rows_go_in_and_out():
    rows = Rows(jnp.arange(6.0), START, SIZE)
    double = {5: lambda x, k: k * x[::-1], 1: lambda x, k: k * x}
    factor = jnp.array([1.0, 2.0, 3.0, 4.0])
    found = apply_by_kind(KIND, double, rows, factor, empty=factor, start=START)
    np.testing.assert_array_equal(found, [3, 0, 8, 6, 5, 4])


def test_no_elements():
    nothing = np.zeros(0, int)
    found = apply_by_kind(nothing, {}, jnp.zeros(0), empty=(np.zeros((0, 3)),))
    assert found[0].shape == (0, 3)
