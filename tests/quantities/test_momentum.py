"""Conservation of momentum in free flight."""

import jax
import mujoco
import numpy as np
from oracle import quick_jit
from random_models import random_model, random_states

from jaxsim.dynamics.aba import forward_dynamics
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.velocity import velocities
from jaxsim.io import load
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.quantities.momentum import center_of_mass, centroidal_momentum


def test_momentum_is_conserved_without_external_forces(rng):
    """Whatever the joints do, armature included; the centre of mass moves in a straight line."""
    xml = random_model(5, bodies=4, trees=1, options=False, welded=False)
    mj = mujoco.MjModel.from_xml_string(xml)
    mj.opt.gravity[:] = 0
    model = load(mj)
    (qpos,), (qvel,) = random_states(mj, seed=0, n=1)
    torque = rng.standard_normal(mj.nv)
    torque[:6] = 0

    def momentum(q, v):
        kin = kinematics(model, q)
        return centroidal_momentum(model, kin, velocities(model, kin, v)), center_of_mass(kin)

    @quick_jit
    def rates(qpos, qvel):
        qacc = forward_dynamics(model, qpos, qvel, torque)
        along = lambda t: momentum(integrate_pos(model, qpos, qvel, t), qvel + t * qacc)  # noqa: E731
        return momentum(qpos, qvel)[0], *jax.jvp(along, (0.0,), (1.0,))[1]

    value, rate, velocity = rates(qpos, qvel)
    assert np.linalg.norm(value) > 0.1
    np.testing.assert_allclose(rate, 0, atol=1e-11)
    np.testing.assert_allclose(velocity * mj.body_mass.sum(), value[3:], atol=1e-12)
