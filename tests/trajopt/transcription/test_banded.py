"""Block-pentadiagonal matrices, against dense ones, by scans and in parallel."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

from jaxsim.trajopt.transcription.banded import assemble, assemble_vector
from jaxsim.trajopt.transcription.parallel import solve_in_parallel


@pytest.mark.parametrize("T", [6, 7])
def test_sums_and_solutions_are_those_of_dense_matrices(x64, rng, T):
    """Local quadratics about three steps each, of which the steps before the first are known."""
    m = 3
    root = rng.normal(size=(T + 1, 3 * m, 3 * m))
    local = root @ root.transpose(0, 2, 1)
    slopes = rng.normal(size=(T + 1, 3 * m))
    # Steps -1 to T + 1; the t-th quadratic is about t - 1, t and t + 1.
    H, g = np.zeros(((T + 3) * m,) * 2), np.zeros((T + 3) * m)
    for t in range(T + 1):
        at = slice(t * m, (t + 3) * m)
        H[at, at] += local[t]
        g[at] += slopes[t]
    unknown = slice(2 * m, -m)
    expected = np.linalg.solve(H[unknown, unknown], g[unknown]).reshape(T, m)

    @quick_jit
    def solve(local, slopes):
        matrix = assemble(local.reshape(T + 1, 3, m, 3, m))
        b = assemble_vector(slopes.reshape(T + 1, 3, m))
        return matrix.solve(b), solve_in_parallel(*matrix, b)

    for found in solve(jnp.asarray(local), jnp.asarray(slopes)):
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11)
