"""Numbers that are not finite, anywhere in a pytree."""

import jax.numpy as jnp
import numpy as np

from jaxsim.arrays.finite import zero_if_finite


def test_zero_if_finite():
    """Integers are passed over, and single precision stays so."""
    tree = {"a": jnp.ones(3), "b": (jnp.arange(2), None)}
    found = zero_if_finite(tree)
    assert found == 0
    assert found.dtype == jnp.float32
    for bad in (np.nan, np.inf, -np.inf):
        assert np.isnan(zero_if_finite(tree | {"c": jnp.asarray([0, bad], jnp.float32)}))
