"""Exact Coulomb friction: the passes of Newton's method against projected Gauss-Seidel."""

import jax
import jax.numpy as jnp
import numpy as np
from dense_operator import DenseOperator
from oracle import quick_jit

from jaxsim.solver import EllipticCone, Problem, solve
from jaxsim.solver.passes import first_shifts, rigid_tolerance, softness, solve_rigid

SETS, CONTACTS, STEP = 1000, 3, 0.01


def random_bodies(rng):
    """Masses (SETS, 12) of two bodies, and Jacobians (SETS, CONTACTS, 3, 12) of their contacts.

    Each body touches the ground at a random point, and the other body.
    """
    mass = np.repeat(10 ** rng.uniform(-1, 1, (SETS, 2, 1)), 6, axis=2)
    mass[:, :, 3:] *= rng.uniform(0.2, 0.6, (SETS, 2, 3)) ** 2
    J = np.zeros((SETS, CONTACTS, 3, 2, 6))
    for contact, sides in enumerate([{0: 1}, {1: 1}, {0: -1, 1: 1}]):
        frame = np.linalg.qr(rng.normal(size=(SETS, 3, 3)))[0]
        for body, sign in sides.items():
            arm = rng.normal(size=(SETS, 1, 3)) * 0.3
            # The velocity of a point is v + omega x arm.
            J[:, contact, :, body] = sign * np.concatenate([frame, np.cross(arm, frame)], axis=2)
    return mass.reshape(SETS, 12), J.reshape(SETS, CONTACTS, 3, 12)


def onto_cone(f, mu):
    """The closest points of friction cones."""
    normal, slip = f[:, :1], f[:, 1:]
    length = np.linalg.norm(slip, axis=1, keepdims=True)
    edge = np.maximum(normal + mu * length, 0) / (1 + mu**2)
    on_edge = np.concatenate([edge, mu * edge * slip / np.where(length > 0, length, 1)], axis=1)
    return np.where(length <= mu * normal, f, on_edge)


def gauss_seidel(mass, J, v, mu, sweeps=4000):
    """Velocities after plastic impacts, by one contact after the other until nothing changes.

    In these variables the law of Coulomb and Signorini is `f = P(f - k (u + mu |u_t| n))` for every
    k > 0, with P the projection onto the cone.
    """
    v, impulse = v.copy(), np.zeros((SETS, CONTACTS, 3))
    response = np.swapaxes(J, 2, 3) / mass[:, None, :, None]
    k = 1 / np.einsum("scij,scji->sc", J, response)[:, :, None]
    for _ in range(sweeps):
        before = v.copy()
        for i in range(CONTACTS):
            u = np.einsum("sij,sj->si", J[:, i], v)
            u[:, 0] += mu[:, 0] * np.linalg.norm(u[:, 1:], axis=1)
            change = onto_cone(impulse[:, i] - k[:, i] * u, mu) - impulse[:, i]
            impulse[:, i] += change
            v += np.einsum("sij,sj->si", response[:, i], change)
        if np.abs(v - before).max() < 1e-13:
            break
    return v


def passes(mass, J, v, mu):
    """The same by the engine's solver, and whether it converged."""
    weight = jnp.einsum("ci,ci->c", J[:, 0], J[:, 0] / mass[None])
    D = 1 / (softness(v.dtype) * weight)
    cone = EllipticCone(
        aref=-J @ v / STEP,
        D=jnp.broadcast_to(D[:, None], (CONTACTS, 3)),
        mu=jnp.full(CONTACTS, mu),
        friction=jnp.full((CONTACTS, 2), mu),
    )
    problem, operator = Problem((cone,)), DenseOperator(jnp.diag(mass), (J,))

    def minimise(problem, guess):
        options = {"iterations": 50, "ls_iterations": 50, "tolerance": 0.0, "ls_tolerance": 0.01}
        return solve(problem, operator, jnp.zeros(12), scale=1.0, x_start=guess, **options)

    found = solve_rigid(
        problem,
        operator,
        (0,),
        minimise,
        jnp.zeros(12),
        first_shifts(problem, (0,)),
        passes=100,
        tolerance=rigid_tolerance(v.dtype),
    )
    return v + STEP * found.x, found.converged


def test_random_impacts_are_those_of_gauss_seidel_and_create_no_energy(x64):
    rng = np.random.default_rng(0)
    mass, J = random_bodies(rng)
    v, mu = rng.normal(size=(SETS, 12)), rng.uniform(0.1, 0.6, (SETS, 1))
    after, converged = quick_jit(jax.vmap(passes))(*map(jnp.asarray, (mass, J, v, mu[:, 0])))
    after, converged = np.asarray(after), np.asarray(converged)
    # Contacts whose friction can press them down by itself may have several solutions, or none.
    G = np.einsum("scij,scj->sci", J, J[:, :, 0] / mass[:, None])
    wedged = (G[:, :, 0] <= mu * np.linalg.norm(G[:, :, 1:], axis=2)).any(axis=1)
    assert converged[~wedged].mean() > 0.99
    judged = converged & ~wedged
    assert judged.sum() > 500
    expected = gauss_seidel(mass, J, v, mu)
    np.testing.assert_allclose(after[judged], expected[judged], atol=1e-7)
    energy = lambda v: np.sum(mass * v * v, axis=1)[judged]  # noqa: E731
    assert (energy(after) <= energy(v) * (1 + 1e-10)).all()
    assert (energy(after) < 0.99 * energy(v)).mean() > 0.5
