"""Laws of mechanics on random trees with every joint type."""

import numpy as np
from oracle import assert_close, oracle_stages


def test_kinetic_energy_is_the_quadratic_form_of_the_mass_matrix(scene):
    form = 0.5 * np.einsum("ni,nij,nj->n", scene.qvel, scene.mass_matrix, scene.qvel)
    assert_close(scene.kinetic, form, 0, 1e-12)


def test_mass_matrix_is_symmetric_and_positive_definite(scene):
    assert_close(scene.mass_matrix, scene.mass_matrix.transpose(0, 2, 1), 0, 1e-13)
    assert np.linalg.eigvalsh(scene.mass_matrix).min() > 0


def test_forward_dynamics_inverts_inverse_dynamics(scene):
    assert_close(scene.forward, scene.qacc, 1e-9, 1e-9)


def test_inverse_dynamics_is_mass_matrix_times_acceleration_plus_bias(scene):
    expected = np.einsum("nij,nj->ni", scene.mass_matrix, scene.qacc) + scene.bias
    assert_close(scene.inverse, expected, 1e-11, 1e-11)


def test_solve_mass_solves_with_the_dense_matrix(scene):
    expected = np.linalg.solve(scene.mass_matrix, scene.qacc[..., None])[..., 0]
    assert_close(scene.solved, expected, 1e-9, 1e-9)


def test_coriolis_matrix_gives_the_velocity_part_of_the_bias(scene):
    product = np.einsum("nij,nj->ni", scene.coriolis, scene.qvel)
    assert_close(product, scene.bias - scene.bias_at_rest, 1e-11, 1e-11)


def test_rate_of_mass_matrix_minus_twice_coriolis_is_skew(scene):
    """`v . (dM/dt - 2 C) v = 0` for every v: Coriolis forces do no work."""
    difference = scene.rate["mass_matrix"] - 2 * scene.coriolis
    assert_close(difference, -difference.transpose(0, 2, 1), 1e-11, 1e-11)


def test_gravity_and_springs_are_gradients_of_the_potential(scene):
    assert_close(scene.potential_gradient, scene.bias_at_rest - scene.spring, 1e-10, 1e-10)


def test_power_is_the_rate_of_energy(scene):
    power = np.einsum("ni,ni->n", scene.qvel, scene.inverse - scene.spring)
    assert_close(scene.rate["energy"], power, 1e-10, 1e-10)


def test_subtree_velocity_is_the_rate_of_its_centre_of_mass(scene):
    assert_close(scene.rate["com"], scene.subtree_linvel, 1e-12, 1e-12)


def test_momentum_matrix_gives_the_momentum(scene):
    product = np.einsum("nij,nj->ni", scene.momentum_matrix, scene.qvel)
    assert_close(product, scene.momentum, 1e-12, 1e-12)


def test_momentum_is_that_of_the_whole_subtree(scene):
    mass = scene.mj.body_subtreemass[0]
    assert_close(scene.momentum[:, 3:], mass * scene.subtree_linvel[:, 0], 1e-12, 1e-12)
    assert_close(scene.momentum[:, :3], scene.subtree_angmom[:, 0], 1e-12, 1e-12)


def test_mass_matrix_is_the_sum_over_bodies_of_jacobians(scene):
    """`M = sum_i Jv^T m Jv + Jw^T I Jw`, up to armature."""
    linear, angular = scene.jacobians[:, :, 3:], scene.jacobians[:, :, :3]
    mass = np.einsum("nbki,b,nbkj->nij", linear, scene.mj.body_mass, linear)
    data = oracle_stages(scene.mj, scene.qpos, scene.qvel)
    inertia = np.einsum("nbij,bj,nbkj->nbik", data["ximat"], scene.mj.body_inertia, data["ximat"])
    mass += np.einsum("nbki,nbkl,nblj->nij", angular, inertia, angular)
    mass[:] += np.diag(np.diagonal(scene.mass_matrix - mass, axis1=1, axis2=2)[0])
    assert_close(mass, scene.mass_matrix, 1e-11, 1e-11)


def test_everything_agrees_with_mujoco(scene):
    theirs = oracle_stages(scene.mj, scene.qpos, scene.qvel)
    assert_close(scene.mass_matrix, theirs["mass_matrix"], 1e-12, 1e-11, "mass_matrix")
    assert_close(scene.bias, theirs["qfrc_bias"], 1e-10, 1e-10, "qfrc_bias")
    assert_close(scene.kinetic, theirs["kinetic_energy"], 1e-11, 1e-11, "kinetic energy")
    assert_close(scene.potential, theirs["potential_energy"], 1e-11, 1e-11, "potential energy")
    assert_close(scene.subtree_linvel, theirs["subtree_linvel"], 1e-11, 1e-11, "subtree_linvel")
    assert_close(scene.subtree_angmom, theirs["subtree_angmom"], 1e-11, 1e-11, "subtree_angmom")
