"""Functions for all lanes against NumPy's in a higher precision: two units in the last place."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from vmap_compare import compiled

from jaxsim.lanes import as_kernel

FUNCTIONS = {
    "sin": (np.sin, 1e3),
    "cos": (np.cos, 1e3),
    "exp": (np.exp, 80.0),
    "log": (lambda x: np.log(np.abs(x)), 1e3),
    "tanh": (np.tanh, 10.0),
}
SPECIAL = [0.0, -0.0, np.inf, -np.inf, np.nan, 1e-30, 1e30, -1e30, 1e6, 88.9, -104.0, 1.0]


def everything(x):
    return [jnp.sin(x), jnp.cos(x), jnp.exp(x), jnp.log(jnp.abs(x)), jnp.tanh(x)]


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_units_in_the_last_place(dtype, x64):
    rng = np.random.default_rng(0)
    columns = [rng.uniform(-size, size, 3001) for _, size in FUNCTIONS.values()]
    x = np.stack([*columns, rng.normal(size=3001) * 1e-3]).astype(dtype)
    found = compiled(jax.vmap(as_kernel(everything), 1, 1), jnp.asarray(x))
    wide = x.astype(np.longdouble)
    for y, (exact, _) in zip(found, FUNCTIONS.values(), strict=True):
        with np.errstate(over="ignore", under="ignore"):
            right = exact(wide)
            rounded = right.astype(dtype)
        known = np.isfinite(rounded) & (np.abs(rounded) > np.finfo(dtype).tiny)
        error = np.abs(np.asarray(y)[known].astype(np.longdouble) - right[known])
        assert (error / np.spacing(np.abs(rounded[known]))).max() < 2


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_ends(dtype, x64):
    """Infinities, NaN, zeros and overflow as NumPy has them; subnormal numbers XLA takes as 0."""
    x = jnp.asarray(np.array(SPECIAL, dtype))
    found = compiled(jax.vmap(as_kernel(everything)), x)
    for y, (exact, _) in zip(found, FUNCTIONS.values(), strict=True):
        with np.errstate(all="ignore"):
            np.testing.assert_allclose(y, exact(np.asarray(x)), rtol=1e-6, atol=1e-45)
