"""Contacts of pairs in blocks."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.collision import detect, find_candidates
from jaxsim.collision.blocks import BLOCK, close_pairs, contacts_in_blocks
from jaxsim.collision.hulls import GAIN
from jaxsim.collision.pairs.capsule import sphere_sphere
from jaxsim.collision.shapes import INACTIVE, Contacts, Shape
from jaxsim.collision.table import SPHERE
from jaxsim.lanes import as_kernel

COUNT = 2 * BLOCK + 3
IDS = (np.arange(COUNT), np.arange(COUNT)[::-1].copy())


def spheres(pos):
    """A sphere of 1 cm at each position."""
    eye = jnp.broadcast_to(jnp.eye(3), (len(pos), 3, 3))
    return Shape(pos, eye, jnp.full((len(pos), 3), 0.01))


def both_ways(pos):
    """Distances and points of all pairs at once, of them in blocks, and which pairs are close."""
    shapes = spheres(pos)
    take = lambda i: jax.tree.map(lambda x: x[jnp.asarray(i)], shapes)  # noqa: E731
    contacts = lambda ids: jax.vmap(sphere_sphere)(*map(take, ids))  # noqa: E731
    first, second = map(take, IDS)
    none = Contacts.none(1, pos.dtype)
    close = close_pairs((SPHERE, SPHERE), first, second, jnp.zeros(COUNT))
    return contacts(IDS), contacts_in_blocks(contacts, none, IDS, close), close


@pytest.fixture
def pos(rng):
    """Three environments: all pairs are close, some are, none is."""
    unit = rng.normal(size=(COUNT, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    return jnp.asarray(
        np.stack([0.005 * unit, 0.012 * unit, unit + 0.1 * np.arange(COUNT)[:, None]])
    )


def test_pairs_that_are_close_have_their_contacts_and_others_none(pos):
    whole, blocks, close = jax.jit(jaxsim.vmap(both_ways))(pos)
    number = close[:2].sum(axis=1)
    assert number[0] == COUNT
    assert 0 < number[1] < COUNT
    whole, blocks = (jnp.concatenate([c.pos, c.dist[..., None]], axis=-1) for c in (whole, blocks))
    np.testing.assert_allclose(blocks[close], whole[close], rtol=1e-5, atol=1e-9)
    assert (blocks[~close][..., 3] == INACTIVE).all()


def test_derivatives_in_both_modes(pos):
    """Of the sum of squared distances of close pairs."""

    def cost(pos, in_blocks):
        whole, blocks, close = both_ways(pos)
        dist = (blocks if in_blocks else whole).dist[:, 0]
        return jnp.sum(jnp.where(close, dist, 0) ** 2)

    for mode in (jax.grad, jax.jacfwd):
        right, found = (jax.jit(mode(lambda x, b=b: cost(x, b)))(pos[1]) for b in (False, True))
        assert np.abs(right).max() > 0
        np.testing.assert_allclose(found, right, rtol=1e-5)


def test_selected_contacts_with_a_mesh_are_those_of_mujoco(x64):
    """Of more spheres beside an octahedron than there are slots and pairs of a block."""
    around = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    balls = "".join(
        f"""<body pos="{1.15 * np.cos(a)} {1.15 * np.sin(a)} {0.1 * np.sin(3 * a)}">
        <freejoint/><geom size=".45"/></body>"""
        for a in around
    )
    mj = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option><flag nativeccd="enable"/></option><asset><mesh name="octahedron"
        vertex="1 0 0 -1 0 0 0 1 0 0 -1 0 0 0 1 0 0 -1"/></asset><default><geom contype="1"
        conaffinity="0"/></default><worldbody><body><freejoint/><geom type="mesh" mesh="octahedron"
        conaffinity="1" contype="0"/></body>{balls}</worldbody></mujoco>"""
    )
    mj.opt.ccd_iterations, mj.opt.ccd_tolerance = 500, 1e-15
    data = mujoco.MjData(mj)
    data.qpos[:3] = 0.1, 0, 0
    mujoco.mj_forward(mj, data)
    model = jaxsim.load(mj)
    candidates = find_candidates(model, max_contacts=data.ncon + 1)
    mat = data.geom_xmat.reshape(-1, 3, 3)
    found = jax.jit(lambda *pose: detect(model, candidates, *pose))(data.geom_xpos, mat)
    assert 4 < data.ncon < 12
    assert found.overflow == 0
    assert found.active.sum() == data.ncon
    ours, theirs = np.asarray(found.dist[found.active]), data.contact.dist
    np.testing.assert_allclose(np.sort(ours), np.sort(theirs), atol=1e-8)


@pytest.fixture
def hulls(rng):
    """Depths and points of three touching hulls at given poses, and a hundred of these.

    The hulls are with and without a table of near corners.
    """
    turn = np.pi * (1 + np.sqrt(5)) * np.arange(120)
    z = 1 - (2 * np.arange(120) + 1) / 120
    ring = np.sqrt(1 - z**2)
    ball = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    corners = " ".join(f"{x:.4f}" for x in ball.ravel())
    mj = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset><mesh name="octahedron" vertex="1 0 0 -1 0 0 0 1 0 0 -1 0 0 0 1 0 0 -1"/>
        <mesh name="ball" vertex="{corners}"/></asset><default><geom type="mesh"/></default>
        <worldbody><body><freejoint/><geom mesh="octahedron"/></body>
        <body><freejoint/><geom mesh="ball"/></body>
        <body><freejoint/><geom mesh="ball"/></body></worldbody></mujoco>"""
    )
    model = jaxsim.load(mj)
    candidates = find_candidates(model)
    assert [len(group) for group in candidates.groups] == [3]
    near = model.hull_size[:, 4]
    assert near.max() * GAIN < model.hull_size[:, 0].max()
    pos = np.array([[0, 0, 0], [1.4, 0, 0], [0, 1.4, 0.1]]) + 0.05 * rng.normal(size=(100, 3, 3))
    mat = np.linalg.qr(rng.normal(size=(100, 3, 3, 3)))[0]
    mat *= np.sign(np.linalg.det(mat))[..., None, None]

    def depths(pos, mat):
        found = detect(model, candidates, pos, mat)
        return jnp.where(found.active, found.dist, 0), found.pos * found.active[:, None]

    return depths, pos, mat


def test_kernels_have_the_code_of_one_pair_of_hulls(hulls):
    depths, *poses = hulls
    found, plain = (
        jax.jit(jax.vmap(f))(*poses) for f in (as_kernel(depths, largest=10**7), depths)
    )
    # Rounding decides between two edges that are as near.
    for one, other in zip(found, plain, strict=True):
        differ = np.abs(np.asarray(one) - np.asarray(other)).reshape(len(one), -1).max(axis=1)
        assert np.mean(differ > 1e-12) < 0.02
    assert (np.asarray(plain[0]) < 0).any(axis=1).all()


@pytest.mark.slow
def test_derivatives_of_kernels_with_hulls(hulls):
    depths, pos, mat = hulls
    slopes = [
        jax.jit(jax.grad(lambda x, f=f: jnp.sum(f(x, mat[0])[0] ** 2)))(pos[0])
        for f in (depths, as_kernel(depths, largest=10**7))
    ]
    np.testing.assert_allclose(*slopes, atol=1e-12)
    assert np.abs(slopes[0]).max() > 1e-3
