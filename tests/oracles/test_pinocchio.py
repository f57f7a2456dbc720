"""Hard contact beside Pinocchio's solvers of the same complementarity problem (extra `oracles`)."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit
from random_contacts import CONTACTS, SETS, after_impact, is_wedged, random_bodies

pytestmark = pytest.mark.slow
TOLERANCE, ITERATIONS = 1e-12, 20_000


class Pinocchio:
    """One of its solvers, "ADMM" or "PGS"; both get the same problem in the space of contacts."""

    def __init__(self, name: str):
        self.pin = pytest.importorskip("pinocchio", reason="needs the extra `oracles`")
        self.name, self.model = name, self.pin.Model()
        free = self.pin.JointModelFreeFlyer()
        self.joint = self.model.addJoint(0, free, self.pin.SE3.Identity(), "free")

    def after_impact(self, mass, J, v, mu):
        """Velocities after plastic impacts, and whether it converged."""
        pin, name = self.pin, self.name
        rows = np.roll(J, -1, axis=1).reshape(-1, len(mass))  # its normals come last
        models, datas = pin.StdVec_ConstraintModel(), pin.StdVec_ConstraintData()
        for _ in range(CONTACTS):
            contact = pin.PointContactConstraintModel(self.model, self.joint)
            contact.setFriction(mu)
            models.append(pin.ConstraintModel(contact))
            datas.append(models[len(models) - 1].createData())
        settings, result = (getattr(pin, f"{name}Solver{x}")() for x in ("Settings", "Result"))
        settings.absolute_feasibility_tol = settings.absolute_complementarity_tol = TOLERANCE
        settings.relative_feasibility_tol = settings.relative_complementarity_tol = 0.0
        settings.max_iterations, settings.solve_ncp = ITERATIONS, True
        delassus = pin.DelassusOperatorDense((rows / mass) @ rows.T)
        solver = getattr(pin, f"{name}ConstraintSolver")(len(rows))
        converged = solver.solve(delassus, rows @ v, models, datas, settings, result)
        return v + (rows.T @ result.retrieveConstraintImpulses()) / mass, converged


@pytest.mark.parametrize("solver", ["ADMM", "PGS"])
def test_random_impacts(solver, x64):
    """A thousand sets of three contacts between two bodies and the ground: 1e-7."""
    pinocchio, rng = Pinocchio(solver), np.random.default_rng(1)
    mass, J = random_bodies(rng)
    v, mu = rng.normal(size=(SETS, mass.shape[1])), rng.uniform(0.1, 0.6, (SETS, 1))
    found, converged = quick_jit(jax.vmap(after_impact))(*map(jnp.asarray, (mass, J, v, mu[:, 0])))
    sets = zip(mass, J, v, mu[:, 0].tolist(), strict=True)
    expected, theirs = zip(*(pinocchio.after_impact(*numbers) for numbers in sets), strict=True)
    judged = np.asarray(converged) & np.array(theirs) & ~is_wedged(mass, J, mu)
    assert judged.sum() > 0.6 * SETS
    np.testing.assert_allclose(np.asarray(found)[judged], np.array(expected)[judged], atol=1e-7)
