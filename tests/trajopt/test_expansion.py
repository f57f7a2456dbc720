"""A problem near a trajectory: the same with kernels, and for many systems at once."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

from jaxsim import trajopt
from jaxsim.lanes import switch
from jaxsim.trajopt.expansion import expand


def test_kernels_change_no_number(x64, monkeypatch):
    """Each column of a Jacobian is a lane; with numbers that are being mapped it cannot be."""
    pytest.importorskip("llvmlite")
    ctrls = jnp.array([[0.3], [1.0], [-0.5]])

    def expansion(gravity):
        def pendulum(x, u):
            return x + 0.1 * jnp.array([x[1], gravity * jnp.sin(x[0]) + u[0]])

        problem = trajopt.make_problem(
            pendulum,
            jnp.array([1.0, 0.5]),
            horizon=3,
            running_cost=lambda x, u, t: x @ x + u @ u * (1 + t),
            nu=1,
            frame_skip=2,
        )
        return expand(problem, problem.rollout(ctrls)[0], ctrls)

    without = quick_jit(lambda: expansion(9.81))()
    monkeypatch.setattr(switch, "_enabled", True)
    found = quick_jit(lambda: (expansion(9.81), jax.vmap(expansion)(jnp.array([9.81, 1.0]))))()
    mapped = jax.tree.map(lambda x: x[0], found[1])
    for other in (found[0], mapped):
        jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-12), other, without)
