"""Float64, and one random tree with every joint type whose quantities are computed once."""

import types

import jax
import mujoco
import numpy as np
import pytest
from oracle import quick_jit
from random_models import random_model, random_states

from jaxsim.dynamics.aba import forward_dynamics, solve_mass
from jaxsim.dynamics.coriolis import coriolis_matrix
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.dynamics.jacobian import body_jacobians
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.rnea import inverse_dynamics, qfrc_bias
from jaxsim.dynamics.velocity import velocities
from jaxsim.forces.spring import qfrc_spring
from jaxsim.io import load
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.quantities.energy import kinetic_energy, potential_energy
from jaxsim.quantities.momentum import (
    centroidal_momentum,
    centroidal_momentum_matrix,
    subtree_velocities,
)

SEEDS = [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 20))]


@pytest.fixture(autouse=True)
def float64():
    """Laws are checked in float64."""
    with jax.enable_x64(True):
        yield


@pytest.fixture(scope="session", params=SEEDS)
def scene(request) -> types.SimpleNamespace:
    """A random tree: the oracle's model, ours, random states, and all quantities there."""
    with jax.enable_x64(True):
        mj = mujoco.MjModel.from_xml_string(random_model(request.param, poly=True))
        model = load(mj)
        qpos, qvel = random_states(mj, seed=1, n=4)
        qacc = np.random.default_rng(2).standard_normal(qvel.shape)
        compute = quick_jit(jax.vmap(quantities, in_axes=(None, 0, 0, 0)))
        values = jax.tree.map(np.asarray, compute(model, qpos, qvel, qacc))
    return types.SimpleNamespace(mj=mj, model=model, qpos=qpos, qvel=qvel, qacc=qacc, **values)


def quantities(model, qpos, qvel, qacc):
    """Everything that the laws are about, at one state."""
    kin = kinematics(model, qpos)
    vel = velocities(model, kin, qvel)
    force = inverse_dynamics(model, qpos, qvel, qacc)
    linvel, angmom = subtree_velocities(model, kin, vel)
    return {
        "mass_matrix": composite_mass_matrix(model, kin),
        "bias": qfrc_bias(model, kin, vel),
        "bias_at_rest": qfrc_bias(model, kin, velocities(model, kin, 0 * qvel)),
        "coriolis": coriolis_matrix(model, kin, vel),
        "kinetic": kinetic_energy(model, kin, vel, qvel),
        "potential": potential_energy(model, kin, qpos),
        "inverse": force,
        "forward": forward_dynamics(model, qpos, qvel, force),
        "solved": solve_mass(model, kin, qacc),
        "momentum": centroidal_momentum(model, kin, vel),
        "momentum_matrix": centroidal_momentum_matrix(model, kin),
        "subtree_linvel": linvel,
        "subtree_angmom": angmom,
        "jacobians": body_jacobians(model, kin, kin.xipos),
        "xipos": kin.xipos,
        "spring": qfrc_spring(model, kin, qpos),
        "potential_gradient": jax.grad(lambda dq: _potential(model, qpos, dq))(0 * qvel),
        "rate": _rates(model, qpos, qvel, qacc),
    }


def _potential(model, qpos, dq):
    moved = integrate_pos(model, qpos, dq, 1.0)
    return potential_energy(model, kinematics(model, moved), moved)


def _rates(model, qpos, qvel, qacc):
    """Derivatives with respect to time along the motion that starts with these accelerations."""

    def along(t):
        q, v = integrate_pos(model, qpos, qvel, t), qvel + qacc * t
        kin = kinematics(model, q)
        vel = velocities(model, kin, v)
        return {
            "mass_matrix": composite_mass_matrix(model, kin),
            "energy": kinetic_energy(model, kin, vel, v) + potential_energy(model, kin, q),
            "com": kin.subtree_com,
            "jacobians": body_jacobians(model, kin, kin.xipos),
        }

    return jax.jvp(along, (0.0,), (1.0,))[1]
