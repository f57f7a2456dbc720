"""Spatial inertia against sums over point masses, and its laws of transformation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from numpy.testing import assert_allclose

from jaxsim.spatial import Inertia, Pose, adjoint, coadjoint, power, quat_exp, spatial_twist


def assert_same_inertia(a, b, atol):
    for x, y in zip(jax.tree.leaves(a), jax.tree.leaves(b), strict=True):
        assert_allclose(x, y, rtol=0, atol=atol)


def test_parallel_axis_theorem_against_point_masses(clouds, bodies, precision):
    """From the centre of mass outwards, as the sum over points about the origin itself."""
    masses, points = clouds
    total = masses.sum(axis=1)
    com = np.einsum("nk,nki->ni", masses, points) / total[:, None]
    arms = points - com[:, None]
    about_com = np.array(
        [
            sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(ms, rs, strict=True))
            for ms, rs in zip(masses, arms, strict=True)
        ]
    )
    arguments = [jnp.asarray(x, precision.dtype) for x in (total, com, about_com)]
    built = jax.vmap(Inertia.from_com)(*arguments)
    assert_same_inertia(built, bodies, 32 * precision.atol)
    assert_allclose(jax.vmap(lambda G: G.com)(bodies), com, atol=4 * precision.atol)
    back = jax.vmap(lambda G: G.rotational_at_com)(bodies)
    assert_allclose(back, about_com, rtol=0, atol=32 * precision.atol)


def test_inertias_of_points_add_up_to_the_body(clouds, bodies, precision):
    masses, points = (jnp.asarray(x[0], precision.dtype) for x in clouds)
    point = jnp.zeros((3, 3), precision.dtype)
    total = Inertia.from_com(masses[0], points[0], point)
    for mass, com in zip(masses[1:], points[1:], strict=True):
        total = total + Inertia.from_com(mass, com, point)
    assert_same_inertia(total, jax.tree.map(lambda x: x[0], bodies), 8 * precision.atol)


def test_momentum_is_the_sum_over_points(clouds, bodies, twists, precision):
    masses, points = clouds
    V = np.asarray(twists, np.float64)
    velocity = V[:, None, 3:] + np.cross(V[:, None, :3], points)
    linear = masses[..., None] * velocity
    expected = np.concatenate([np.cross(points, linear), linear], axis=-1).sum(axis=1)
    actual = jax.vmap(Inertia.apply)(bodies, twists)
    assert_allclose(actual, expected, rtol=0, atol=64 * precision.atol)
    energy = 0.5 * np.einsum("nk,nki,nki->n", masses, velocity, velocity)
    actual_energy = jax.vmap(Inertia.kinetic_energy)(bodies, twists)
    assert_allclose(actual_energy, energy, rtol=8 * precision.atol)


def test_matrix_is_symmetric_and_is_the_product(bodies, twists, precision):
    G = jax.vmap(Inertia.as_matrix)(bodies)
    assert_allclose(G, jnp.swapaxes(G, 1, 2), rtol=0, atol=16 * precision.atol)
    expected = jnp.einsum("nij,nj->ni", G, twists)
    actual = jax.vmap(Inertia.apply)(bodies, twists)
    assert_allclose(actual, expected, rtol=0, atol=64 * precision.atol)


def test_solve_inverts_the_product(bodies, twists, precision):
    back = jax.vmap(lambda G, V: G.solve(G.apply(V)))(bodies, twists)
    assert_allclose(back, twists, rtol=0, atol=400 * precision.atol)


def test_transformation_is_the_congruence_by_adjoint(bodies, poses, precision):
    """``G_A = Ad^-T G_B Ad^-1``."""

    def reference(G, X):
        return coadjoint(X) @ G.as_matrix() @ coadjoint(X).T

    actual = jax.vmap(lambda G, X: G.transform(X).as_matrix())(bodies, poses)
    expected = jax.vmap(reference)(bodies, poses)
    assert_allclose(actual, expected, rtol=0, atol=256 * precision.atol)


def test_kinetic_energy_does_not_depend_on_the_frame(bodies, poses, twists, precision):
    there = jax.vmap(lambda G, X, V: G.transform(X).kinetic_energy(spatial_twist(X, V)))
    energy = jax.vmap(Inertia.kinetic_energy)(bodies, twists)
    scale = jax.vmap(lambda X: jnp.abs(adjoint(X)).max() ** 4)(poses)
    errors = jnp.abs(there(bodies, poses, twists) - energy)
    assert (errors <= 8 * precision.atol * scale * (1 + energy)).all()


def test_rotation_and_shift_compose_to_the_transformation(bodies, poses, precision):
    whole = jax.vmap(Inertia.transform)(bodies, poses)
    parts = jax.vmap(lambda G, X: G.rotate(X.quat).shift(X.pos))(bodies, poses)
    assert_same_inertia(whole, parts, 0)
    back = jax.vmap(lambda G, X: G.transform(X.inverse()))(whole, poses)
    assert_same_inertia(back, bodies, 256 * precision.atol)
    moved = jax.vmap(lambda G, X: X.apply(G.com) - G.transform(X).com)(bodies, poses)
    assert_allclose(moved, np.zeros(moved.shape), atol=16 * precision.atol)


def test_energy_is_half_the_power_of_momentum(bodies, twists):
    energy = jax.vmap(Inertia.kinetic_energy)(bodies, twists)
    assert_allclose(energy, 0.5 * jax.vmap(power)(twists, jax.vmap(Inertia.apply)(bodies, twists)))


def test_principal_frame(x64):
    pose = Pose(quat=quat_exp(jnp.array([0.0, 0.0, np.pi / 2])), pos=jnp.array([1.0, 0.0, 0.0]))
    G = Inertia.from_principal(2.0, pose, jnp.array([1.0, 2.0, 3.0]))
    # A quarter turn exchanges x and y; the arm of 1 m along x adds 2 kg m^2 about y and z.
    assert_allclose(G.rotational, np.diag([2.0, 3.0, 5.0]), atol=1e-15)
    assert_allclose(G.first_moment, [2.0, 0.0, 0.0])


def test_body_without_mass_has_finite_centre_and_derivatives():
    def com(mass):
        return Inertia(mass=mass, first_moment=jnp.zeros(3), rotational=jnp.eye(3)).com

    assert_allclose(com(jnp.asarray(0.0)), np.zeros(3))
    assert jnp.isfinite(jax.jacfwd(com)(0.0)).all()
    assert jnp.isfinite(jax.jacrev(com)(0.0)).all()


def test_mass_takes_the_precision_of_the_arrays():
    G = Inertia.from_com(2, jnp.zeros(3), jnp.eye(3))
    assert G.mass.dtype == G.rotational.dtype == jnp.float32


def test_real_bodies_have_no_violations(bodies):
    for n in range(0, len(bodies.mass), 20):
        assert jax.tree.map(lambda x, n=n: x[n], bodies).violations() == ()


def test_a_small_part_far_from_the_origin_is_no_violation():
    """Rounding of the moment about the origin must not be taken for a bad inertia."""
    com = jnp.array([3.0, 1.0, -2.0])
    assert Inertia.from_com(1.0, com, 1e-4 * jnp.eye(3)).violations() == ()


@pytest.mark.parametrize(
    ("mass", "rotational", "message"),
    [
        (0.0, np.eye(3), "mass is 0 kg, it must be positive"),
        (np.nan, np.eye(3), "mass is nan kg"),
        (1.0, np.diag([1.0, 1.0, np.inf]), "not finite"),
        (1.0, np.eye(3) + np.eye(3, k=1), "not symmetric"),
        (1.0, np.diag([-0.1, 1.0, 1.0]), "smallest principal moment is negative, -0.1"),
        (1.0, np.diag([1.0, 1.0, 2.5]), "1, 1, 2.5 break the triangle inequality"),
    ],
)
def test_violations_say_what_is_wrong(mass, rotational, message):
    G = Inertia(
        mass=jnp.asarray(mass), first_moment=jnp.zeros(3), rotational=jnp.asarray(rotational)
    )
    assert message in " ".join(G.violations())


def test_wrong_shapes_are_refused():
    with pytest.raises(ValueError, match=r"shapes \(\), \(3,\), \(3, 3\), not"):
        Inertia.from_com(1.0, jnp.zeros(3), jnp.ones(3))
