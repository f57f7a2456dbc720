"""Every pair function against MuJoCo's contacts, and its derivatives against differences."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from pair_sizes import ALL, GENERAL

from jaxsim.collision import INACTIVE, PAIRS, Shape
from jaxsim.collision.table import type_name

# Those without a closed form and those of meshes have tests of their own.
NAMES = [names for names in ALL if names not in GENERAL and "mesh" not in names]
MARGIN = 0.03
# Where two boxes are aligned, which corner lies on which face changes with nearly every input.
SMOOTH_WHERE_ALIGNED = {("box", "box"): 0.3}
SQRT_HALF = np.sqrt(0.5)
ROTATIONS = np.array(
    [[1, 0, 0, 0], [SQRT_HALF, SQRT_HALF, 0, 0], [SQRT_HALF, 0, SQRT_HALF, 0], [0, 1, 0, 0]]
)
OFFSETS = np.array(
    [[0, 0, 0], [0, 0, 0.13], [0, 0, -0.1], [0.12, 0, 0], [0, 0.1, 0.1], [0.1, 0, 0.2]]
)


def random_poses(rng, n):
    """(n, 14): pose of the first shape, pose of the second, near enough to touch often."""
    quats = rng.normal(size=(2, n, 4))
    quats /= np.linalg.norm(quats, axis=-1, keepdims=True)
    pos1 = rng.uniform(-1, 1, (n, 3))
    return np.concatenate(
        [pos1, quats[0], pos1 + rng.uniform(-0.25, 0.25, (n, 3)), quats[1]], axis=1
    )


def special_poses():
    """(24, 14): aligned, parallel, perpendicular and coincident shapes."""
    rows = [[0, 0, 0, 1, 0, 0, 0, *offset, *quat] for offset in OFFSETS for quat in ROTATIONS]
    return np.array(rows, float)


def shapes(model, data):
    """Both geoms as arrays, from MuJoCo's own kinematics."""
    return [
        (data.geom_xpos[i].copy(), data.geom_xmat[i].reshape(3, 3).copy(), model.geom_size[i])
        for i in range(2)
    ]


@functools.cache
def pair_function(names):
    key = next(k for k in PAIRS if tuple(map(type_name, k)) == names)
    return jax.jit(PAIRS[key].function)


def evaluate(names):
    function = pair_function(names)

    def f(first, second):
        contacts = function(Shape(*first), Shape(*second))
        return contacts.dist, contacts.pos, contacts.frame

    return jax.jit(jax.vmap(f))


def stack(pairs):
    return jax.tree.map(lambda *x: jnp.asarray(np.stack(x)), *pairs)


def assert_same_contacts(ours, contacts, atol=1e-10):
    dist, pos, frame = ours
    kept = [i for i in range(len(dist)) if dist[i] <= MARGIN]
    assert len(kept) == len(contacts)
    for c in contacts:
        error = [abs(dist[i] - c.dist) + np.abs(pos[i] - c.pos).max() for i in kept]
        i = kept.pop(int(np.argmin(error)))
        np.testing.assert_allclose(dist[i], c.dist, atol=atol)
        np.testing.assert_allclose(pos[i], c.pos, atol=atol)
        np.testing.assert_allclose(frame[i].ravel(), c.frame, atol=atol)


@pytest.mark.parametrize("names", NAMES, ids="-".join)
@pytest.mark.parametrize("kind", ["random", "special"])
def test_agrees_with_mujoco(names, kind, rng, two_geoms, contacts_of):
    model = two_geoms(*names)
    poses = random_poses(rng, 150) if kind == "random" else special_poses()
    datas = [contacts_of(model, p[7:], p[:7]) for p in poses]
    ours = jax.device_get(evaluate(names)(*stack([shapes(model, d) for d in datas])))
    for i, data in enumerate(datas):
        if not ambiguous_frame(names, data):
            assert_same_contacts([x[i] for x in ours], data.contact)
    depths = np.array([c.dist for d in datas for c in d.contact])
    assert (depths < 0).any()
    if kind == "random":
        assert (depths > 0).any()
        assert any(d.ncon == 0 for d in datas)


def ambiguous_frame(names, data):
    """Capsule upright on a plane: MuJoCo's first tangent is then rounding noise, normalised."""
    across = np.cross(data.geom_xmat[0].reshape(3, 3)[:, 2], data.geom_xmat[1].reshape(3, 3)[:, 2])
    return names == ("plane", "capsule") and 0 < np.linalg.norm(across) < 1e-12


@pytest.mark.parametrize("names", NAMES, ids="-".join)
def test_frames_are_rotations_and_values_finite(names, rng, two_geoms, contacts_of):
    model = two_geoms(*names)
    poses = np.concatenate([random_poses(rng, 20), special_poses()])
    inputs = stack([shapes(model, contacts_of(model, p[7:], p[:7])) for p in poses])
    for dtype, atol in ((jnp.float64, 1e-12), (jnp.float32, 1e-5)):
        dist, pos, frame = evaluate(names)(*jax.tree.map(lambda x, t=dtype: x.astype(t), inputs))
        assert {x.dtype for x in (dist, pos, frame)} == {jnp.dtype(dtype)}
        assert all(np.isfinite(x).all() for x in (dist, pos, frame))
        gram = np.einsum("nkij,nklj->nkil", frame, frame)
        np.testing.assert_allclose(gram, np.broadcast_to(np.eye(3), gram.shape), atol=atol)
        np.testing.assert_allclose(np.linalg.det(np.asarray(frame)), 1, atol=10 * atol)


@pytest.mark.parametrize("names", NAMES, ids="-".join)
def test_derivatives(names, rng, two_geoms, contacts_of):
    """Both modes agree, are finite everywhere, and right wherever the function is smooth."""
    model = two_geoms(*names)
    poses = np.concatenate([random_poses(rng, 12), special_poses()])
    rows = [shapes(model, contacts_of(model, p[7:], p[:7])) for p in poses]
    x = jnp.asarray(
        np.stack([np.concatenate([np.ravel(v) for s in row for v in s]) for row in rows])
    )
    function = pair_function(names)

    def f(x):
        halves = [Shape(v[:3], v[3:12].reshape(3, 3), v[12:]) for v in (x[:15], x[15:])]
        c = function(*halves)
        return jnp.concatenate([c.dist, c.pos.ravel(), c.frame.ravel()])

    both = jax.jit(jax.vmap(lambda x: (jax.jacfwd(f)(x), jax.jacrev(f)(x))))
    forward, backward = jax.device_get(both(x))
    assert np.isfinite(forward).all()
    np.testing.assert_allclose(backward, forward, atol=1e-11)

    h = 1e-6
    steps = jnp.asarray(h * np.eye(30))
    sample = jax.jit(jax.vmap(jax.vmap(f, (0,)), (0,)))
    plus, minus, middle = (
        np.asarray(sample(x[:, None] + sign * steps[None])).swapaxes(1, 2) for sign in (1, -1, 0)
    )
    curvature = np.abs(plus - 2 * middle + minus).max(axis=1) / h**2
    slope = np.abs(plus - minus).max(axis=1) / (2 * h)
    smooth = (curvature < 1e3) & (slope < 1e3)  # of each pose, along each input
    assert smooth[:12].mean() > 0.97
    assert smooth[12:].mean() > SMOOTH_WHERE_ALIGNED.get(names, 0.6)
    difference = ((plus - minus) / (2 * h)).swapaxes(1, 2)[smooth]
    np.testing.assert_allclose(forward.swapaxes(1, 2)[smooth], difference, atol=1e-6, rtol=1e-6)


def place(name, pos, axis=(0, 0, 1), size=(0.1, 0.2, 0.3)):
    axis = np.asarray(axis, float)
    x = np.cross([0.3, 0.8, -0.5], axis)
    x /= np.linalg.norm(x)
    mat = np.stack([x, np.cross(axis, x), axis], axis=1)
    return Shape(*(jnp.asarray(v, float) for v in (pos, mat, size)))


def test_derivative_of_distance_vanishes_where_centres_coincide():
    def dist(p):
        return pair_function(("sphere", "sphere"))(
            place("sphere", p), place("sphere", (0, 0, 0))
        ).dist[0]

    np.testing.assert_array_equal(jax.grad(dist)(jnp.zeros(3)), 0)
    np.testing.assert_array_equal(jax.jit(jax.jacfwd(jax.grad(dist)))(jnp.zeros(3)), 0)


@pytest.mark.parametrize(
    ("offset", "ends"), [(0.0, [-0.2, 0.2]), (0.1, [-0.1, 0.2]), (-0.3, [-0.2, -0.1])]
)
@pytest.mark.parametrize("sign", [1, -1])
def test_parallel_capsules_touch_at_the_ends_of_their_overlap(offset, ends, sign):
    axis, across = np.array([0.6, 0.0, 0.8]), np.array([0, 0.15, 0])
    first = place("capsule", (0, 0, 0), axis)
    second = place("capsule", offset * axis + across, sign * axis)
    contacts = pair_function(("capsule", "capsule"))(first, second)
    np.testing.assert_allclose(contacts.dist, -0.05, atol=1e-12)
    expected = np.array([e * axis + across / 2 for e in ends])
    np.testing.assert_allclose(contacts.pos[::sign], expected, atol=1e-12)


def test_almost_parallel_capsules_agree_with_mujoco(rng, two_geoms, contacts_of):
    """On both sides of the angle at which the second contact appears, overlapping or not."""
    model = two_geoms("capsule", "capsule")
    poses = []
    for angle in (0.0, 3e-6, 9.9e-5, 1.01e-4, 1e-3):
        for _ in range(30):
            axis = rng.normal(size=3)
            quat = np.array([np.cos(angle / 2), *(axis / np.linalg.norm(axis) * np.sin(angle / 2))])
            offset = [*rng.uniform(-0.2, 0.2, 2), rng.uniform(-0.4, 0.4)]
            poses.append([0, 0, 0, 1, 0, 0, 0, *offset, *quat])
    datas = [contacts_of(model, p[7:], p[:7]) for p in np.array(poses)]
    evaluated = evaluate(("capsule", "capsule"))(*stack([shapes(model, d) for d in datas]))
    ours = jax.device_get(evaluated)
    for i, data in enumerate(datas):
        assert_same_contacts([x[i] for x in ours], data.contact, atol=1e-9)
    assert {d.ncon for d in datas} == {0, 1, 2}


def test_crossing_capsules_leave_the_second_slot_empty():
    contacts = pair_function(("capsule", "capsule"))(
        place("capsule", (0, 0, 0)), place("capsule", (0.15, 0, 0), (0, 1, 0))
    )
    np.testing.assert_allclose(contacts.dist, [-0.05, INACTIVE], atol=1e-12)


def test_resting_box_has_its_lower_face():
    contacts = pair_function(("plane", "box"))(
        place("plane", (0, 0, 0)), place("box", (0, 0, 0.29))
    )
    np.testing.assert_allclose(contacts.dist, -0.01, atol=1e-12)
    np.testing.assert_allclose(contacts.pos[:, 2], -0.005, atol=1e-12)
