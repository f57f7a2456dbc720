"""Bounded quadratic programs against SciPy's bounded least squares."""

import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize

from jaxsim.trajopt.box_qp import box_qp


def test_minimisers_of_random_programs(x64, rng):
    count, m = 100, 6
    roots = rng.normal(size=(count, m + 2, m)) * 10 ** rng.uniform(-1, 1, (count, 1, m))
    right = rng.normal(size=(count, m + 2))
    low = -rng.exponential(size=(count, m)) * 0.2
    high = rng.exponential(size=(count, m)) * 0.2
    low[0], high[0] = -np.inf, np.inf
    low[1, :3] = high[1, :3] = 0.1  # nothing left to choose for these
    hessian = np.einsum("bki,bkj->bij", roots, roots)
    gradient = np.einsum("bki,bk->bi", roots, right)
    found = jax.jit(jax.vmap(box_qp))(*map(jnp.asarray, (hessian, gradient, low, high)))
    for i in range(count):
        if i == 1:
            np.testing.assert_array_equal(found.u[i, :3], 0.1)
            continue
        best = scipy.optimize.lsq_linear(
            roots[i], -right[i], (low[i], high[i]), method="bvls", tol=1e-15
        )
        np.testing.assert_allclose(found.u[i], best.x, atol=1e-7, err_msg=str(i))
        inside = (best.x > low[i] + 1e-9) & (best.x < high[i] - 1e-9)
        np.testing.assert_array_equal(found.free[i], inside, err_msg=str(i))
