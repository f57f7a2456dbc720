"""Factors and solves by LAPACK: values, derivatives, and one matrix a call under `jax.vmap`."""

import re

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from vmap_compare import assert_equal, assert_same, compiled, with_derivatives

import jaxsim
from jaxsim import trajopt
from jaxsim.batching import matrices
from jaxsim.trajopt.transcription.banded import Pentadiagonal

RNG = np.random.default_rng(0)
A = RNG.normal(size=(3, 4, 4))
B = RNG.normal(size=(3, 4))


def solved(A, b):
    """By LU, by Cholesky factors and by eigenvalues of one matrix."""
    S = A @ A.T + jnp.eye(4)
    L = matrices.cholesky(S)
    half = matrices.triangular_solve(L, b, lower=True)
    return matrices.solve(A, b), matrices.cholesky_solve(L, b), half @ half, matrices.eigh(S)[0]


def expected(A, b):
    S = A @ A.T + jnp.eye(4)
    x = jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(S), True), b)
    return jnp.linalg.solve(A, b), x, b @ x, jnp.linalg.eigvalsh(S)


def mapped(f, axes):
    """`jax.vmap` of f and its derivatives, as a function of the arguments."""
    return lambda *xs: with_derivatives(jax.vmap, f, xs, {"in_axes": axes}, ("jvp", "vjp"))


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("axes", [(0, 0), (None, 0), (1, None)])
def test_values_and_derivatives(axes):
    """Those of JAX's functions, whichever operands are mapped; also by `jaxsim.vmap`."""
    a = A if axes[0] == 0 else A[0] if axes[0] is None else np.moveaxis(A, 0, 1)
    args = (a, B if axes[1] == 0 else B[0])
    found, right = (compiled(mapped(f, axes), *args) for f in (solved, expected))
    assert_equal(found, right)
    assert_same(solved, *args, in_axes=axes)


@pytest.mark.usefixtures("x64")
def test_maps_within_maps_and_second_derivatives():
    def f(A, bs):
        return jax.vmap(lambda b: solved(A, b)[0] @ b)(bs)

    def right(A, bs):
        return jax.vmap(lambda b: jnp.linalg.solve(A, b) @ b)(bs)

    bs = RNG.normal(size=(3, 2, 4))
    for g in (lambda f: f, lambda f: jax.hessian(lambda A, b: f(A, b).sum())):
        found, wanted = (compiled(jax.vmap(g(one)), A, bs) for one in (f, right))
        np.testing.assert_allclose(found, wanted, rtol=1e-9)


BALLS = "".join(
    f'<body pos="0 0 {0.1 + 0.19 * i}"><freejoint/><geom size=".1"/></body>' for i in range(2)
)
ARM = '<body name="{0}"><joint name="{0}" axis="0 1 0"/><geom size=".1" pos=".3 0 0"/></body>'
TENDON = (
    '<tendon><fixed armature=".1" damping="1"><joint joint="a" coef="1"/>'
    '<joint joint="b" coef="2"/></fixed></tendon>'
)
SCENES = {
    # Coupled rows and a dense matrix of the integrator.
    "balls": f'<option integrator="implicit"/><worldbody>{BALLS}</worldbody>',
    # A mass matrix with coupling, and a damping matrix.
    "tendon": '<option integrator="implicitfast"/>'
    f"<worldbody>{ARM.format('a')}{ARM.format('b')}{BALLS}</worldbody>{TENDON}",
}


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="LAPACK is the library of a CPU")
@pytest.mark.parametrize("name", SCENES)
def test_no_batch_for_lapack_in_steps_that_users_map(name):
    """A batch would wait for threads, for ever if several devices do at once."""
    mj = mujoco.MjModel.from_xml_string(f"<mujoco>{SCENES[name]}</mujoco>")
    model = jaxsim.load(mj)
    state = jax.tree.map(lambda x: jnp.stack([x, x]), jaxsim.make_state(model))

    def slope(state):
        return jax.grad(lambda v: jaxsim.step(model, state.replace(qvel=v)).qvel.sum())(state.qvel)

    assert _unbatched_calls(jax.vmap(slope), state) == {"spotrf", "sgetrf", "strsm"}


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="LAPACK is the library of a CPU")
def test_no_batch_for_lapack_in_plans_that_users_map():
    """Nor for the Hessians of the steps, which the method itself maps over."""

    def planned(x):
        problem = trajopt.make_problem(
            lambda x, u: x + u, x, horizon=3, running_cost=lambda x, u, t: x @ x + u @ u, nu=2
        )
        return trajopt.solve(problem, trajopt.ILQR(iterations=2)).cost

    assert "ssyevd" in _unbatched_calls(jax.vmap(planned), jnp.ones((5, 2)))
    rows = Pentadiagonal(*jnp.ones((3, 5, 4, 2, 2)))
    assert _unbatched_calls(jax.vmap(Pentadiagonal.solve), rows, jnp.ones((5, 4, 2)))


def _unbatched_calls(f, *args) -> set[str]:
    """Names of the functions of LAPACK in a program; none gets more than one matrix."""
    program = jax.jit(f).lower(*args).as_text()
    calls = re.findall(r"@lapack_(\w+)_ffi.*-> *(.*)", program)
    assert not [kind for _, kind in calls if re.search(r"tensor<\d+x\d+x\d+x", kind)]
    return {call for call, _ in calls}
