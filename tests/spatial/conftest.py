"""Samples of rotations, poses and bodies: far from the identity, very near it, at half a turn."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.spatial import Inertia, Pose, quat_exp

# Angles of the samples; 0.5 is where the coefficient functions change from series to closed form.
ANGLES = (0.0, 1e-12, 1e-7, 1e-4, 0.02, 0.4999, 0.5001, 1.0, 2.5, np.pi - 1e-3, np.pi - 1e-6, np.pi)


@pytest.fixture(params=["float32", "float64"])
def precision(request):
    """The dtype under test and the rounding to be expected from values of order one."""
    with jax.enable_x64(request.param == "float64"):
        dtype = jnp.dtype(request.param)
        yield SimpleNamespace(dtype=dtype, atol=16 * float(jnp.finfo(dtype).eps))


@pytest.fixture
def rotation_vectors():
    """Every angle about every coordinate axis and some skew axes, as (n, 3) NumPy float64."""
    axes = np.concatenate(
        [np.eye(3), -np.eye(3)[1:2], np.random.default_rng(1).normal(size=(3, 3))]
    )
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    return (np.asarray(ANGLES)[:, None, None] * axes[None]).reshape(-1, 3)


@pytest.fixture
def vectors(rotation_vectors):
    """As many ordinary vectors as there are rotations."""
    return np.random.default_rng(2).normal(size=rotation_vectors.shape)


@pytest.fixture
def quats(precision, rotation_vectors):
    """Unit quaternions of the sampled rotations, in shuffled order and of both signs."""
    order = np.random.default_rng(3).permutation(len(rotation_vectors))
    q = jax.vmap(quat_exp)(jnp.asarray(rotation_vectors[order], precision.dtype))
    sign = jnp.where(jnp.arange(len(order)) % 2 == 0, 1.0, -1.0).astype(precision.dtype)
    return q * sign[:, None]


@pytest.fixture
def poses(precision, quats, vectors):
    """Poses with the sampled rotations, in the order of ``quats``."""
    return Pose(quat=quats, pos=jnp.asarray(vectors, precision.dtype))


@pytest.fixture
def twists(precision, rotation_vectors):
    """Ordinary twists, as many as there are poses."""
    values = np.random.default_rng(4).normal(size=(len(rotation_vectors), 6))
    return jnp.asarray(values, precision.dtype)


@pytest.fixture
def clouds(rotation_vectors):
    """Bodies as five point masses each: masses (n, 5), points (n, 5, 3), NumPy float64."""
    rng = np.random.default_rng(5)
    count = len(rotation_vectors)
    return rng.uniform(0.1, 1.0, size=(count, 5)), rng.normal(size=(count, 5, 3))


@pytest.fixture
def bodies(precision, clouds):
    """The spatial inertias of the point clouds, summed in NumPy."""
    masses, points = clouds
    squares = np.einsum("nk,nki,nki->n", masses, points, points)[:, None, None] * np.eye(3)
    return Inertia(
        mass=jnp.asarray(masses.sum(axis=1), precision.dtype),
        first_moment=jnp.asarray(np.einsum("nk,nki->ni", masses, points), precision.dtype),
        rotational=jnp.asarray(
            squares - np.einsum("nk,nki,nkj->nij", masses, points, points), precision.dtype
        ),
    )
