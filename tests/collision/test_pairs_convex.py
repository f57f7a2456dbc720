"""The general routine: distances are the largest separations, and have derivatives."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit
from pair_sizes import GENERAL, hulls, values
from scipy.spatial.transform import Rotation

from jaxsim.collision import PAIRS, Shape
from jaxsim.collision.table import type_name

N = 200
# A curved, a capped, a flat and a straight solid, each in some pair.
DERIVED = [
    ("capsule", "ellipsoid"),
    pytest.param(("cylinder", "box"), marks=pytest.mark.slow),
    ("mesh", "mesh"),
]


def support(name, size, hull, d):
    """Largest product of d with a point of a solid; d has a leading axis."""
    if name == "mesh":
        return np.max(d @ (hull.corner * size).T, axis=1)
    if name == "sphere":
        return size[0] * np.linalg.norm(d, axis=1)
    if name == "capsule":
        return size[0] * np.linalg.norm(d, axis=1) + size[1] * np.abs(d[:, 2])
    if name == "cylinder":
        return size[0] * np.hypot(d[:, 0], d[:, 1]) + size[1] * np.abs(d[:, 2])
    if name == "box":
        return np.abs(d) @ size
    return np.linalg.norm(d * size, axis=1)


def separation(names, pos, mat, size, hull, normal):
    """How far apart two solids are along a normal."""
    first = support(names[0], size[0], hull[0], np.einsum("nji,nj->ni", mat[:, 0], normal))
    second = support(names[1], size[1], hull[1], -np.einsum("nji,nj->ni", mat[:, 1], normal))
    return np.sum(normal * (pos[:, 1] - pos[:, 0]), axis=1) - first - second


def random_poses(rng, n=N):
    """Positions and rotations of two bodies, which touch about half of the time."""
    quat = rng.normal(size=(n, 2, 4))
    quat /= np.linalg.norm(quat, axis=2, keepdims=True)
    pos = np.zeros((n, 2, 3))
    pos[:, 1] = rng.uniform(-0.25, 0.25, (n, 3))
    return pos, quat


def posed(model, contacts_of, pos, quat):
    """MuJoCo's data, and the geoms' positions and rotations: those of a mesh are not the body's."""
    datas = [
        contacts_of(model, [*p[1], *q[1]], [*p[0], *q[0]]) for p, q in zip(pos, quat, strict=True)
    ]
    geoms = [(d.geom_xpos, d.geom_xmat.reshape(2, 3, 3)) for d in datas]
    return datas, *(np.array(x) for x in zip(*geoms, strict=True))


@pytest.mark.parametrize("names", GENERAL, ids="-".join)
def test_distance_is_the_separation_along_the_normal(names, rng, two_geoms, contacts_of):
    """No direction is better: neither any of a thousand, nor one close to the normal.

    Where flat solids overlap deeply the routine, like MuJoCo's, may end at the second best face.
    Where a face of a polytope or cylinder lies on a face or an edge, its normal is that of the
    contact, as in MuJoCo.
    """
    model = two_geoms(*names)
    shapes = model.geom_size, hulls(model)
    _, pos, mat = posed(model, contacts_of, *random_poses(rng))
    dist, _, normal = jax.device_get(values(names)(pos, mat, *shapes))
    deepest = np.argmin(dist, axis=1)
    clipped = set(names) <= {"capsule", "cylinder", "box", "mesh"}
    exact = (dist.min(axis=1) > 0) | (np.sum(dist < 1, axis=1) == 1) | (not clipped)
    assert exact.mean() > 0.7
    dist, normal = dist[np.arange(N), deepest], normal[np.arange(N), deepest]
    along = functools.partial(separation, names, pos, mat, *shapes)
    np.testing.assert_allclose(along(normal)[exact], dist[exact], atol=1e-6)
    better = np.zeros(N, bool)
    for direction in rng.normal(size=(1000, 3)):
        unit = np.broadcast_to(direction / np.linalg.norm(direction), normal.shape)
        better |= along(unit) > dist + 1e-4
    assert not better[exact & (dist > -0.03)].any()
    assert better[exact].mean() <= 0.01
    for _ in range(20):
        near = normal + rng.normal(scale=1e-3, size=normal.shape)
        near /= np.linalg.norm(near, axis=1, keepdims=True)
        assert (along(near) <= dist + 1e-7)[exact].all()


@pytest.mark.parametrize("name", ["sphere", "capsule", "ellipsoid", "cylinder"])
def test_no_face_of_a_mesh_is_better_where_a_small_solid_is_inside(name, rng, two_geoms):
    names = name, "mesh"
    model = two_geoms(*names)
    size, hull = model.geom_size * [[0.2], [1]], hulls(model)
    quat = rng.normal(size=(N, 2, 4))
    mat = Rotation.from_quat(quat.reshape(-1, 4)).as_matrix().reshape(N, 2, 3, 3)
    pos = np.zeros((N, 2, 3))
    pos[:, 0] = rng.uniform(-0.04, 0.04, (N, 3))
    dist = np.asarray(values(names)(pos, mat, size, hull)[0]).min(axis=1)
    assert dist.max() < 0
    faces = hull[1].faces.normal[hull[1].row] / size[1]
    faces /= np.linalg.norm(faces, axis=1, keepdims=True)
    along = [separation(names, pos, mat, size, hull, -mat[:, 1] @ face) for face in faces]
    assert (dist >= np.max(along, axis=0) - 1e-6).all()


def test_many_corners_agree_with_mujoco(rng, contacts_of):
    """Two bodies of 1,500 corners, up to 3 cm deep: faces next to each other hardly differ."""
    corners = rng.normal(size=(2, 1500, 3))
    corners *= [0.1, 0.12, 0.09] / np.linalg.norm(corners, axis=2, keepdims=True)
    meshes = (" ".join(f"{x:.7f}" for x in c.ravel()) for c in corners)
    one, two = (f'<mesh name="{n}" vertex="{v}"/>' for n, v in zip("ab", meshes, strict=True))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option ccd_iterations="200" ccd_tolerance="1e-10"/><asset>{one}{two}</asset>
        <worldbody><body mocap="true"><geom type="mesh" mesh="a"/></body>
        <body><freejoint/><geom type="mesh" mesh="b"/></body></worldbody></mujoco>"""
    )
    pos, quat = random_poses(rng)
    pos[:, 1] *= rng.uniform(0.17, 0.2, (N, 1)) / np.linalg.norm(pos[:, 1], axis=1, keepdims=True)
    datas, pos, mat = posed(model, contacts_of, pos, quat)
    with pytest.warns(UserWarning, match="maxhullvert"):
        shapes = model.geom_size, hulls(model)
    dist, _, normal = jax.device_get(values(("mesh", "mesh"))(pos, mat, *shapes))
    normal = normal[np.arange(N), np.argmin(dist, axis=1)]
    count = np.array([data.ncon for data in datas])
    theirs = [d.contact.frame[0, :3] for d in datas if d.ncon]
    off = np.abs(normal[count > 0] - theirs).max(axis=1) > 1e-6
    assert len(off) > 150
    assert off.mean() < 0.02
    assert np.mean(count != np.sum(dist < 0, axis=1)) < 0.01
    deepest = [d.contact.dist.min() for d in datas if d.ncon]
    deeper = np.abs(np.min(dist, axis=1)[count > 0] - deepest)
    assert np.mean(deeper > 1e-6) < 0.02


@pytest.mark.parametrize("names", GENERAL, ids="-".join)
def test_agrees_with_mujoco(names, rng, two_geoms, contacts_of):
    """Its depth of curved solids is that of a polytope inside them, by iteration limit."""
    model = two_geoms(*names)
    model.opt.ccd_iterations, model.opt.ccd_tolerance = 200, 1e-8
    datas, pos, mat = posed(model, contacts_of, *random_poses(rng))
    dist, middle, normal = jax.device_get(values(names)(pos, mat, model.geom_size, hulls(model)))
    errors = []
    for i, data in enumerate(datas):
        k = np.argmin(dist[i])
        assert (data.ncon > 0) == (dist[i, k] < 0.03) or abs(dist[i, k] - 0.03) < 1e-4
        if data.ncon and dist[i, k] > -0.02:
            c = data.contact[np.argmin(data.contact.dist)]
            errors.append([abs(c.dist - dist[i, k]), np.abs(c.pos - middle[i, k]).max()])
            errors[-1].append(np.abs(c.frame[:3] - normal[i, k]).max())
    assert len(errors) > 20
    assert (np.quantile(errors, 0.8, axis=0) < [1e-5, 1e-3, 5e-3]).all()


@pytest.mark.slow
def test_almost_aligned_cylinders(benchmark_module, two_geoms):
    """Parallel or at right angles up to a tilt: lines of their sides are almost level."""
    names, rng, count = ("cylinder", "cylinder"), np.random.default_rng(3), 1024
    poses, truth = benchmark_module("collision_poses"), benchmark_module("collision_truth")
    size = two_geoms(*names).geom_size

    def contacts(pos, mat):
        dist, _, normal = values(names)(pos, mat, size, [None, None])
        return np.asarray(dist), np.asarray(normal)

    target = rng.uniform(-1e-3, 5e-3, count)
    pos, mat = poses.move_to(target, poses.aligned_poses(names, rng, count), contacts)
    expected = truth.signed_distances(poses.model(names, 0.0), pos, mat)
    dist, _ = contacts(pos, mat)
    # Others are between a cap and a side or a cap, along the cap's normal, as in MuJoCo.
    exact = np.sum(dist < 1, axis=1) == 1
    assert exact.mean() > 0.2
    np.testing.assert_allclose(dist.min(axis=1)[exact], expected[exact], atol=3e-7)


@functools.cache
def derivatives(names):
    """Batched function: a directional derivative, and the gradient of a product of the values."""
    function = PAIRS[next(k for k in PAIRS if tuple(map(type_name, k)) == names)].function

    def both(x, tangent, cotangent, hull):
        def f(pos, mat, size):
            c = function(*(Shape(pos[i], mat[i], size[i], hull[i]) for i in range(2)))
            there = c.dist < 1
            return jnp.where(there, c.dist, 0), jnp.where(there[:, None], c.pos, 0), c.normal

        forward = jax.jvp(f, x, tangent)[1]
        return forward, jax.vjp(f, *x)[1](cotangent)

    return quick_jit(jax.vmap(both, in_axes=(0, 0, 0, None)))


def products(first, second):
    """Scalar products of each element of a batch."""
    pairs = zip(first, second, strict=True)
    return sum(np.sum((a * b).reshape(len(a), -1), axis=1) for a, b in pairs)


def rotated(mat, spin, angle):
    """Rotations turned about axes."""
    skew = np.cross(spin[..., None, :], np.eye(3)).swapaxes(-1, -2)
    first, second = np.sin(angle), 1 - np.cos(angle)
    return (np.eye(3) + first * skew + second * skew @ skew) @ mat, skew @ mat


@pytest.mark.parametrize("names", DERIVED, ids="-".join)
def test_derivatives_are_those_of_differences(names, rng, two_geoms, contacts_of):
    """Along random changes of poses and sizes, forward and in reverse."""
    model = two_geoms(*names)
    hull = hulls(model)
    _, pos, mat = posed(model, contacts_of, *random_poses(rng, N))
    size = np.broadcast_to(model.geom_size, (N, 2, 3))
    spin = rng.normal(size=(N, 2, 3))
    spin /= np.linalg.norm(spin, axis=2, keepdims=True)
    tangent = rng.normal(size=pos.shape), rotated(mat, spin, 0.0)[1], size * 0.3

    def moved(h):
        turned = rotated(mat, spin, h)[0]
        x = pos + h * tangent[0], turned, model.geom_size * (1 + 0.3 * h), hull
        dist, middle, normal = jax.device_get(values(names)(*x))
        there = dist < 1
        parts = [np.where(there, dist, 0), np.where(there[..., None], middle, 0), normal[:, 0]]
        return np.concatenate([p.reshape(N, -1) for p in parts], axis=1)

    dist = np.asarray(values(names)(pos, mat, model.geom_size, hull)[0])
    slots = dist.shape[1]
    cotangent = tuple(rng.normal(size=(N, *s)) for s in ((slots,), (slots, 3), (1, 3)))
    x = pos, mat, size
    forward, backward = jax.device_get(derivatives(names)(x, tangent, cotangent, hull))
    np.testing.assert_allclose(products(backward, tangent), products(forward, cotangent), atol=1e-8)
    h = 1e-6
    plus, middle, minus = moved(h), moved(0.0), moved(-h)
    smooth = np.abs(plus - 2 * middle + minus).max(axis=1) < 1e-9
    # The corners of the polygon that stands for a cap are held fixed on it.
    normal = values(names)(pos, mat, model.geom_size, hull)[2][:, 0]
    cosine = np.abs(np.sum(normal * mat[:, 0, :, 2], axis=1))
    smooth &= ~((names[0] == "cylinder") & (cosine > 0.99) & (np.sum(dist < 1, axis=1) > 1))
    smooth &= dist.min(axis=1) > -0.08  # not so deep that another feature is as good
    assert smooth.mean() > 0.6
    ours = np.concatenate([x.reshape(N, -1) for x in forward], axis=1)
    difference = (plus - minus) / (2 * h)
    np.testing.assert_allclose(ours[smooth], difference[smooth], atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize("names", DERIVED, ids="-".join)
def test_derivatives_are_finite_where_there_is_no_normal(names, rng, two_geoms):
    """Coincident centres, parallel and orthogonal axes."""
    model = two_geoms(*names)
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    mat = np.array([[np.eye(3), m] for m in (np.eye(3), turn, turn.T) for _ in range(4)])
    offset = np.array([[0.0, 0, 0], [0, 0, 0.2], [0.15, 0, 0], [0.1, 0.1, 0.24]] * 3)
    pos = np.stack([np.zeros_like(offset), offset], axis=1)
    x = pos, mat, np.broadcast_to(model.geom_size, (12, 2, 3))
    slots = values(names)(pos, mat, model.geom_size, hulls(model))[0].shape[1]
    seeds = [rng.normal(size=(12, *s)) for s in ((slots,), (slots, 3), (1, 3))]
    tangent = tuple(rng.normal(size=v.shape) for v in x)
    found = derivatives(names)(x, tangent, tuple(seeds), hulls(model))
    assert all(np.isfinite(g).all() for g in jax.tree.leaves(found))
