"""A mesh on a plane: MuJoCo's contacts one by one, and in their order."""

from types import SimpleNamespace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.collision import Shape
from jaxsim.collision.hulls import Hulls
from jaxsim.collision.pairs.plane import plane_mesh
from jaxsim.io.hulls import hull_tables

MARGIN = 0.004
CUBE = np.array(np.meshgrid((-1, 1), (-1, 1), (-1, 1))).reshape(3, -1).T
# Where corners are level up to rounding, MuJoCo may start at another one of them.
TILTS = [1e-4, 1e-3, 1e-2, 0.1]


def prism(sides):
    """A prism with a smaller upper side; all its edges are different."""
    angle = 2 * np.pi * (np.arange(sides) + 0.3 * np.sin(np.arange(sides))) / sides
    ring = np.stack([0.12 * np.cos(angle), 0.09 * np.sin(angle)], axis=1)
    return np.concatenate([np.insert(s * ring, 2, z, axis=1) for s, z in ((1, -0.06), (0.7, 0.07))])


def meshes():
    rng = np.random.default_rng(5)
    return {
        "cube": CUBE * 0.1,
        "foot": CUBE * [0.12, 0.05, 0.01],
        "needle": CUBE * [0.4, 0.003, 0.004],
        "prism": prism(11),
        "cone": np.append(prism(100)[:100], [[0, 0, 0.2]], axis=0),
        "stone": rng.normal(size=(12, 3)) * [0.1, 0.07, 0.05],
        "pebble": rng.normal(size=(150, 3)) * 0.05,
    }


def scene():
    """A plane, and each mesh twice, with and without a margin."""
    assets, bodies = "", ""
    for name, corners in meshes().items():
        assets += f'<mesh name="{name}" vertex="{" ".join(f"{x:.6f}" for x in corners.ravel())}"/>'
        for margin in (0, MARGIN):
            bodies += f"""<body><freejoint/><geom type="mesh" mesh="{name}" margin="{margin}"
              contype="0"/></body>"""
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset>{assets}</asset><worldbody>
        <geom type="plane" size="1 1 1" pos=".1 .2 .3" euler="10 20 0"/>{bodies}
        </worldbody></mujoco>"""
    )


def place(model, data, rng, lie):
    """Put all bodies near the plane, turned at random or with a face on it, up to a tilt."""
    up = data.geom_xmat[0].reshape(3, 3)[:, 2]
    for geom in range(1, model.ngeom):
        quat = data.qpos[7 * (geom - 1) + 3 :][:4]
        quat[:] = rng.normal(size=4)
        if lie:
            mesh = model.geom_dataid[geom]
            start, count = model.mesh_polyadr[mesh], model.mesh_polynum[mesh]
            mujoco.mju_mulQuat(
                quat,
                _least_turn(model.mesh_polynormal[start + rng.integers(count)], -up),
                model.geom_quat[geom] * [1, -1, -1, -1],
            )
            tilt = np.append(1, rng.choice(TILTS) * rng.normal(size=3))
            mujoco.mju_mulQuat(quat, tilt, quat.copy())
        quat /= np.linalg.norm(quat)
    mujoco.mj_kinematics(model, data)
    for geom in range(1, model.ngeom):
        mesh = model.geom_dataid[geom]
        start = model.mesh_vertadr[mesh]
        vertices = model.mesh_vert[start : start + model.mesh_vertnum[mesh]]
        height = (vertices @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]) @ up
        depth = rng.choice([-0.003, -1e-9, 1e-6, 0.003, 0.03])
        rise = data.geom_xpos[0] @ up - height.min() - depth
        data.qpos[7 * (geom - 1) :][:3] += rise * up
    mujoco.mj_fwdPosition(model, data)


def _least_turn(start, end):
    """The quaternion that turns one unit vector to another."""
    quat = np.append(1 + start @ end, np.cross(start, end))
    return quat / np.linalg.norm(quat)


def poses(rng, model, count):
    """(count, ngeom, 3), (count, ngeom, 3, 3), and MuJoCo's distances and points for each."""
    data = mujoco.MjData(model)
    for k in range(count):
        place(model, data, rng, lie=k % 2 == 1)
        found = [[] for _ in range(model.ngeom)]
        for c in data.contact:
            found[c.geom[1]].append([c.dist, *c.pos])
        yield data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy(), found


@pytest.fixture(scope="module")
def world():
    return scene()


def contacts_of_all(model, dtype):
    """Function of positions and rotations of all geoms to the meshes' distances and points."""
    fields = SimpleNamespace(**hull_tables(model, lambda kind, index: f"{kind} {index}"))
    table = Hulls(fields, np.arange(1, model.ngeom), dtype)
    rows = jnp.asarray(fields.geom_hull[1:], jnp.int32)
    sizes = jnp.asarray(model.geom_size, dtype)

    def contacts(pos, mat, size):
        def of_one(row, *pose_and_size):
            mesh = table.complete(Shape(*pose_and_size), row)
            found = plane_mesh(Shape(pos[0], mat[0], size[0]), mesh)
            return found.dist, found.pos

        return jax.vmap(of_one)(rows, pos[1:], mat[1:], size[1:])

    return lambda pos, mat: contacts(pos, mat, sizes), contacts


def test_contacts_are_mujocos(world, rng):
    pos, mat, theirs = zip(*poses(rng, world, 60), strict=True)
    f, _ = contacts_of_all(world, float)
    dist, middle = jax.device_get(quick_jit(jaxsim.vmap(f))(np.array(pos), np.array(mat)))
    counts = np.zeros(5, int)
    for k, found in enumerate(theirs):
        for geom in range(1, world.ngeom):
            kept = dist[k, geom - 1] <= world.geom_margin[geom]
            ours = np.column_stack([dist[k, geom - 1], middle[k, geom - 1]])[kept]
            assert len(ours) == len(found[geom])
            np.testing.assert_allclose(ours, np.reshape(found[geom], (-1, 4)), atol=1e-9)
            counts[len(ours)] += 1
    assert (counts > 20).all()


def test_float32_is_as_deep(world, rng):
    pos, mat = (np.array(x, np.float32) for x in list(zip(*poses(rng, world, 20), strict=True))[:2])
    deepest = [
        quick_jit(jaxsim.vmap(contacts_of_all(world, t)[0]))(pos.astype(t), mat.astype(t))[0]
        for t in (np.float32, np.float64)
    ]
    assert deepest[0].dtype == np.float32
    np.testing.assert_allclose(*(np.min(d, axis=2) for d in deepest), atol=1e-6)


def test_derivatives_are_right_and_finite_where_level(world, rng):
    """By pose and size; both modes agree."""
    f = contacts_of_all(world, float)[1]
    size = np.asarray(world.geom_size)
    level = np.zeros((world.ngeom, 3)), np.tile(np.eye(3), (world.ngeom, 1, 1)), size
    ((pos, mat, _),) = poses(rng, world, 1)
    both = quick_jit(lambda *x: (jax.jacfwd(f, (0, 1, 2))(*x), jax.jacrev(f, (0, 1, 2))(*x)))
    for x in (level, (pos, mat, size)):
        forward, backward = (jax.tree.leaves(d) for d in jax.device_get(both(*x)))
        for a, b in zip(forward, backward, strict=True):
            assert np.isfinite(a).all()
            np.testing.assert_allclose(b, a, atol=1e-12)
    g = jax.jit(f)
    steps = [rng.normal(size=v.shape) for v in (pos, mat, size)]
    change = quick_jit(lambda *s: jax.jvp(f, (pos, mat, size), s)[1])(*steps)
    ahead, behind = (
        g(*(v + h * s for v, s in zip((pos, mat, size), steps, strict=True))) for h in (1e-7, -1e-7)
    )
    for slope, one, other in zip(change, ahead, behind, strict=True):
        np.testing.assert_allclose(slope, (one - other) / 2e-7, atol=1e-6)
