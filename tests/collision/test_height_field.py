"""Height fields: prisms as MuJoCo's."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.collision import detect, model_candidates
from jaxsim.collision.pairs.prism import point_prisms

HEIGHTS = " ".join(f"{x:.3f}" for x in np.random.default_rng(0).random(63))
SCENE = """<mujoco><asset><hfield name="hills" nrow="7" ncol="9" size="1 .6 .2 .2"
  elevation="{heights}"/></asset><worldbody>
  <geom type="hfield" hfield="hills" pos="0 0 .1" euler="10 0 20"/>
  <body><freejoint/><geom {geom}/></body></worldbody></mujoco>"""


def random_scenes(geom, rng, count=60):
    mj = mujoco.MjModel.from_xml_string(SCENE.format(heights=HEIGHTS, geom=geom))
    data, scenes = mujoco.MjData(mj), []
    for _ in range(count):
        quat = rng.normal(size=4)
        pos = [rng.uniform(-1, 1), rng.uniform(-0.6, 0.6), rng.uniform(0.15, 0.45)]
        data.qpos[:] = [*pos, *quat / np.linalg.norm(quat)]
        mujoco.mj_fwdPosition(mj, data)
        pose = data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy()
        scenes.append((*pose, data.contact.dist.copy(), data.contact.pos.copy()))
    return mj, scenes


def separations_of_box(mj, pos, mat):
    """Of a box from each prism: the largest along normals of faces and products of edges."""
    nrow, ncol, (x, y, z, base) = mj.hfield_nrow[0], mj.hfield_ncol[0], mj.hfield_size[0]
    grid = np.stack(np.meshgrid(np.linspace(-x, x, ncol), np.linspace(-y, y, nrow)), axis=-1)
    points = np.concatenate([grid, z * mj.hfield_data.reshape(nrow, ncol, 1)], axis=2)
    axes = mat[0].T @ mat[1]
    signs = np.stack(np.meshgrid(*[[-1, 1]] * 3), axis=-1).reshape(-1, 3)
    corners = mat[0].T @ (pos[1] - pos[0]) + signs * mj.geom_size[1] @ axes.T
    a, b, c, d = points[:-1, :-1], points[1:, :-1], points[:-1, 1:], points[1:, 1:]
    found = []
    for top in np.stack([[a, b, d], [a, c, d]], axis=3).transpose(1, 2, 3, 0, 4).reshape(-1, 3, 3):
        bottom = np.column_stack([top[:, :2], np.full(3, -base)])
        edges = np.concatenate([np.roll(x, 1, axis=0) - x for x in (top, bottom)] + [[[0, 0, 1]]])
        crossed = np.cross(edges[:, None], np.concatenate([axes.T, edges]))
        n = np.concatenate([crossed.reshape(-1, 3), axes.T])
        n = n[np.linalg.norm(n, axis=1) > 1e-9]
        n = np.concatenate([n, -n])
        n /= np.linalg.norm(n, axis=1, keepdims=True)
        solid = np.concatenate([top, bottom])
        found.append(np.max((corners @ n.T).min(axis=0) - (solid @ n.T).max(axis=0)))
    return np.array(found)


@pytest.mark.parametrize(
    ("geom", "same_depth"),
    [
        ('type="sphere" size=".12"', True),
        # MuJoCo's depth of flat solids in a prism is not the least one.
        pytest.param('type="box" size=".08 .1 .12"', False, marks=pytest.mark.slow),
    ],
    ids=["sphere", "box"],
)
def test_contacts_are_mujocos(geom, same_depth, rng, x64):
    """As many, and as deep; beyond the border, too."""
    mj, scenes = random_scenes(geom, rng)
    model = jaxsim.load(mj)
    candidates = model_candidates(model)
    found = quick_jit(jaxsim.vmap(lambda x, r: detect(model, candidates, x, r).dist))
    pos, mat = (np.array([s[k] for s in scenes]) for k in range(2))
    double, single = (
        np.asarray(jax.device_get(found(pos.astype(t), mat.astype(t)))) for t in ("d", "f")
    )
    near = np.abs(double) < 0.01
    np.testing.assert_allclose(single[near], double[near], atol=1e-6)
    touched = 0
    for dist, (xpos, xmat, expected, _) in zip(double, scenes, strict=True):
        ours, expected = np.sort(dist[dist < 0]), np.sort(expected)[:8]
        assert len(ours) == len(expected)
        touched += len(expected) > 0
        if same_depth:
            np.testing.assert_allclose(ours, expected, atol=1e-6)
        else:
            least = np.sort(separations_of_box(mj, xpos, xmat))[:8]
            np.testing.assert_allclose(ours, least[least < 0], atol=1e-12)
    assert 10 < touched < 55


def test_contacts_of_a_small_sphere_are_in_mujocos_order(rng, x64):
    """It lies on at most four cells. MuJoCo's positions are exact where its centre is outside."""
    mj, scenes = random_scenes('type="sphere" size=".09"', rng, 200)
    model = jaxsim.load(mj)
    found = quick_jit(jaxsim.vmap(lambda x, r: detect(model, model_candidates(model), x, r)))
    contacts = jax.device_get(found(*(np.array([s[k] for s in scenes]) for k in range(2))))
    shallow = 0
    for dist, pos, (_, _, expected, points) in zip(
        contacts.dist, contacts.pos, scenes, strict=True
    ):
        np.testing.assert_allclose(dist[dist < 0], expected, atol=1e-6)
        outside = expected > -0.09
        shallow += outside.sum()
        np.testing.assert_allclose(pos[dist < 0][outside], points[outside], atol=1e-10)
    assert shallow > 100
    assert not contacts.overflow.any()


def test_a_field_of_one_cell_has_two_contacts(x64):
    """Slots beyond the number of prisms stay empty."""
    one = SCENE.replace('nrow="7" ncol="9"', 'nrow="2" ncol="2"')
    mj = mujoco.MjModel.from_xml_string(
        one.format(heights="0 1 .3 .6", geom='type="sphere" size=".3"')
    )
    model, data = jaxsim.load(mj), mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    pose = data.geom_xpos, data.geom_xmat.reshape(-1, 3, 3)
    contacts = quick_jit(lambda x, r: detect(model, model_candidates(model), x, r))(*pose)
    assert contacts.active.sum() == data.ncon == 2


STEP, BASE = np.array([0.3, 0.2]), 0.4
GRID = np.random.default_rng(1).uniform(0, 0.2, (3, 3))


def sides(point):
    """Distances and normals of a point from eight prisms, as one array."""
    x, y = (point[k] - STEP[k] * np.arange(3) for k in range(2))
    dist, normal = point_prisms((x, y), jnp.asarray(GRID), point[2], jnp.asarray(STEP), BASE)
    return jnp.concatenate([dist, normal.ravel()])


def test_derivatives_of_a_point_and_prisms(rng, x64):
    """Right at random points, around and inside; finite on corners, edges, faces and walls."""
    low, high = [-0.1, -0.1, -0.5], [0.7, 0.5, 0.4]
    corners = [[0.3 * i, 0.2 * j, GRID[j, i]] for i in range(3) for j in range(3)]
    middle = np.mean([corners[0], corners[3], corners[4]], axis=0)
    special = [*corners, middle, middle - [0, 0, 0.1], [0.3, 0.1, 0.0], [0.15, 0.1, -BASE]]
    special += [np.mean([a, b], axis=0) for a in corners for b in corners[:4]]
    points = jnp.asarray(np.concatenate([rng.uniform(low, high, (300, 3)), special]))
    both = quick_jit(jax.vmap(lambda x: (sides(x), jax.jacfwd(sides)(x), jax.jacrev(sides)(x))))
    values, forward, backward = both(points)
    assert np.isfinite(forward).all()
    np.testing.assert_allclose(np.linalg.norm(values[:, 8:].reshape(-1, 3), axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(backward[:300], forward[:300], atol=1e-11)
    h = 1e-6
    step = h * np.eye(3)[None]
    plus, minus = (both((points[:300, None] + s * step).reshape(-1, 3)) for s in (1, -1))
    difference = (np.asarray(plus[0]) - minus[0]).reshape(300, 3, -1).swapaxes(1, 2) / (2 * h)
    smooth = np.abs(np.asarray(plus[1] - minus[1]).reshape(300, 3, -1, 3)).max(axis=(1, 3)) < 1e-3
    assert smooth.mean() > 0.97
    np.testing.assert_allclose(forward[:300][smooth], difference[smooth], atol=1e-6)


def test_what_finds_no_slot_is_counted(x64):
    """A box on more triangles than a pair has slots; a box beyond the cells that are tested."""
    level = SCENE.format(heights=" ".join(["1"] * 63), geom='type="box" size=".23 .27 .1"')
    mj = mujoco.MjModel.from_xml_string(level.replace("10 0 20", "0 0 0"))
    model, data = jaxsim.load(mj), mujoco.MjData(mj)
    candidates = model_candidates(model)
    data.qpos[:3] = 0.03, 0.02, 0.19
    mujoco.mj_fwdPosition(mj, data)
    pos, mat = data.geom_xpos.copy(), data.geom_xmat.reshape(-1, 3, 3).copy()

    def overflow(height, size):
        raised = pos + height * np.array([[0, 0, 0], [0, 0, 1]])
        return detect(model.replace(geom_size=size), candidates, raised, mat).overflow

    count = quick_jit(overflow)
    assert count(0.0, model.geom_size) == data.ncon - 8 > 0
    assert count(0.1, model.geom_size) == 0
    assert count(1.0, 3 * model.geom_size) > 0
