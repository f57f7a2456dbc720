"""Primal-dual steps: the same minimum as Newton's, in fewer steps where friction turns."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from dense_operator import DenseOperator
from oracle import quick_jit

from jaxsim.solver import EllipticCone, Problem, solve

BODIES, CONTACTS, STIFFER = 20, 50, 900.0


def test_piled_contacts_take_fewer_steps_to_the_same_minimum(x64):
    """Point masses that are coupled at random, with friction much stiffer than the normals."""
    rng, nv = np.random.default_rng(0), 3 * BODIES
    J = np.zeros((CONTACTS, 3, BODIES, 3))
    for contact in range(CONTACTS):
        frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        first, second = rng.choice(BODIES, 2, replace=False)
        J[contact, :, first], J[contact, :, second] = frame, -frame
    mu = np.full(CONTACTS, 0.5)
    D = np.tile(40.0 * np.array([1, STIFFER, STIFFER]), (CONTACTS, 1))
    cone = EllipticCone(
        jnp.zeros((CONTACTS, 3)),
        jnp.asarray(D),
        jnp.asarray(mu / np.sqrt(STIFFER)),
        jnp.full((CONTACTS, 2), 0.5),
    )
    problem = Problem((cone,))
    operator = DenseOperator(jnp.eye(nv), (jnp.asarray(J.reshape(CONTACTS, 3, nv)),))

    @functools.partial(quick_jit, static_argnums=1)
    @functools.partial(jax.vmap, in_axes=(0, None))
    def solved(force, kinked):
        options = {"iterations": 200, "ls_iterations": 50, "tolerance": 1e-12}
        found = solve(
            problem, operator, force, None, ls_tolerance=0.01, scale=1.0, kinked=kinked, **options
        )
        return found.x, found.status

    forces = jnp.asarray(rng.normal(size=(20, nv)) * 10)
    (x, status), (expected, newton) = solved(forces, True), solved(forces, False)
    assert status.converged.all()
    np.testing.assert_allclose(x, expected, atol=1e-6)
    assert status.residual.max() < 1e-5
    assert status.iterations.mean() < 0.85 * newton.iterations.mean()
