"""Lower bounds of distances: below every contact, and close where it matters."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

from jaxsim.collision import PAIRS, Shape
from jaxsim.collision.bounds import HALF_WIDTH, distance_bound
from jaxsim.collision.table import BOX, CAPSULE, CYLINDER, ELLIPSOID, MESH, PLANE, SPHERE

SIZES = {
    PLANE: (0, 0, 0),
    SPHERE: (0.11, 0, 0),
    CAPSULE: (0.07, 0.3, 0),
    ELLIPSOID: (0.08, 0.12, 0.2),
    CYLINDER: (0.09, 0.15, 0),
    BOX: (0.05, 0.11, 0.3),
}
KNOWN = [types for types in PAIRS if set(types) <= set(SIZES)]


def name(types):
    return "-".join(mujoco.mjtGeom(t).name.removeprefix("mjGEOM_").lower() for t in types)


def shape(kind, pos=(0, 0, 0), quat=(1, 0, 0, 0), dtype="float64"):
    mat = np.zeros(9)
    mujoco.mju_quat2Mat(mat, np.array(quat, float) / np.linalg.norm(quat))
    return Shape(*(np.array(x, dtype) for x in (pos, mat.reshape(3, 3), SIZES[kind])))


def random_shapes(kind, rng, count, dtype):
    some = [shape(kind, 0.25 * rng.normal(size=3), rng.normal(size=4), dtype) for _ in range(count)]
    return jax.tree.map(lambda *x: np.stack(x), *some)


def bound_of(*posed):
    """Of shapes given as (type, position, quaternion)."""
    types = tuple(p[0] for p in posed)
    return float(quick_jit(functools.partial(distance_bound, types))(*(shape(*p) for p in posed)))


def test_every_shape_has_a_width():
    assert {t for types in PAIRS for t in types} - {PLANE} <= set(HALF_WIDTH)


@pytest.mark.parametrize("kind", [k for k in SIZES if k != PLANE], ids=lambda k: name([k]))
def test_the_largest_width_is_that_of_mujocos_bounding_sphere(kind, rng):
    size = " ".join(map(str, SIZES[kind]))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="{name([kind])}" size="{size}"/></worldbody></mujoco>'
    )
    axes = rng.normal(size=(20000, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    widths = quick_jit(jax.vmap(lambda u: HALF_WIDTH[kind](shape(kind), u)))(axes)
    assert widths.max() <= model.geom_rbound[0] + 1e-12
    assert widths.max() >= 0.999 * model.geom_rbound[0]


@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize("types", KNOWN, ids=name)
def test_no_contact_is_closer(types, dtype, rng):
    shapes = [random_shapes(t, rng, 400, dtype) for t in types]
    dist = quick_jit(jax.vmap(lambda a, b: PAIRS[types].function(a, b).dist.min()))(*shapes)
    bound = quick_jit(jax.vmap(functools.partial(distance_bound, types)))(*shapes)
    rounding = 20 * float(jnp.finfo(dtype).eps)
    assert (bound <= dist + rounding).all()
    # It tells most of those that are apart.
    assert (bound[dist > 0.1] > 0).mean() > 0.7
    if types[0] == PLANE:
        np.testing.assert_allclose(bound, dist, atol=rounding)


@pytest.mark.parametrize("other", [SPHERE, CYLINDER], ids=lambda t: name([t]))
def test_the_bound_of_a_mesh_is_that_of_its_box(other, rng):
    shapes = [random_shapes(t, rng, 100, "float64") for t in (other, BOX)]
    as_mesh, as_box = (
        quick_jit(jax.vmap(functools.partial(distance_bound, (other, t))))(*shapes)
        for t in (MESH, BOX)
    )
    np.testing.assert_array_equal(as_mesh, as_box)


def test_tall_posts_side_by_side_are_apart():
    """Their bounding spheres overlap."""
    assert bound_of((CAPSULE,), (CAPSULE, (0.2, 0, 0))) == pytest.approx(0.2 - 0.14)
    for z in (0, 0.1, 0.5):
        assert bound_of((CAPSULE,), (CYLINDER, (0.2, 0, z))) >= 0.2 - 0.16 - 1e-9


def test_faces_of_boxes_tell_what_the_direction_of_centres_does_not():
    """One is above a corner of the other's large face."""
    tilted = (BOX, (0.2, 0.1, 0.25), (1, 0, 0.2, 0))
    lying = (BOX, (0, 0, 0), (1, 0, 1, 0))  # its thin side is vertical
    assert bound_of((SPHERE, (0.29, 0.1, 0.2)), lying) == pytest.approx(0.2 - 0.11 - 0.05)
    assert bound_of(tilted, lying) > -0.15


@pytest.mark.parametrize("types", [t for t in KNOWN if t[0] != PLANE], ids=name)
def test_coincident_centres_are_in_contact(types):
    assert bound_of(*((t,) for t in types)) < -0.05
