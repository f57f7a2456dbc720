"""Two bodies with random contacts, and what the engine's passes make of them."""

import jax.numpy as jnp
import numpy as np
from dense_operator import DenseOperator

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


def after_impact(mass, J, v, mu):
    """Velocities of one set after plastic impacts, and whether the passes converged."""
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
        return solve(
            problem,
            operator,
            jnp.zeros(12),
            guess,
            iterations=50,
            ls_iterations=50,
            tolerance=0.0,
            ls_tolerance=0.01,
            scale=1.0,
            compare=False,
            reduction=1e-4,
        )

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


def is_wedged(mass, J, mu):
    """Whether friction alone can press a contact down: it may have several solutions, or none."""
    G = np.einsum("scij,scj->sci", J, J[:, :, 0] / mass[:, None])
    return (G[:, :, 0] <= mu * np.linalg.norm(G[:, :, 1:], axis=2)).any(axis=1)
