"""Meshes that collide: their hulls, what is refused, what costs nothing."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

CUBE = "-1 -1 -1  1 -1 -1  1 1 -1  -1 1 -1  -1 -1 1  1 -1 1  1 1 1  -1 1 1"
TETRAHEDRON = "0 0 0  1 0 0  0 1 0  0 0 1"


def scene(geom, more="", asset=""):
    return f"""<mujoco><option tolerance="0" iterations="100"/><asset>
    <mesh name="cube" vertex="{CUBE}" scale=".1 .2 .15"/>
    <mesh name="tetrahedron" vertex="{TETRAHEDRON}" scale=".3 .3 .3"/>{asset}</asset><worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 .149"><freejoint/><geom name="first" {geom}/></body>{more}
    </worldbody></mujoco>"""


def ball(vertices):
    points = np.random.default_rng(0).normal(size=(vertices, 3))
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    return " ".join(f"{x:.6f}" for x in points.ravel())


def faces_of(model):
    """The corners around each face of the first hull."""
    return [model.hull_ring[start : start + count] for start, count in model.hull_face[0]]


def test_a_corner_knows_its_faces_and_edges():
    model = jaxsim.load(scene('type="mesh" mesh="cube"'))
    corners, faces = model.hull_corner[0], faces_of(model)
    assert model.hull_size.tolist() == [[8, 6, 4, 3, 8]]
    for k, (start, count) in enumerate(model.hull_at[0]):
        around, places = (x[start : start + count] for x in (model.hull_around, model.hull_place))
        assert count == 3
        assert (np.diff(around) > 0).all()
        for face, place in zip(around, places, strict=True):
            ring = np.roll(faces[face], -faces[face].tolist().index(corners[k].tolist()), axis=0)
            np.testing.assert_array_equal(ring[-1], corners[model.hull_before[place]])
            np.testing.assert_array_equal(ring[1:], corners[model.hull_others[place]])


def test_faces_enclose_the_corners():
    """In units of the size: all corners are below each face, whose corners are on it in order."""
    model = jaxsim.load(scene('type="mesh" mesh="cube"'))
    corners, normals, faces = model.hull_corner[0], model.hull_normal[0], faces_of(model)
    assert corners.shape == (8, 3)
    assert [len(face) for face in faces] == [4] * 6
    np.testing.assert_allclose(np.abs(corners), 1, atol=1e-6)
    for normal, face in zip(normals, faces, strict=True):
        np.testing.assert_allclose(face @ normal, np.max(corners @ normal), atol=1e-6)
        assert np.cross(face[1] - face[0], face[2] - face[1]) @ normal > 0


def test_forward_agrees_with_mujoco(x64):
    """A cube of a mesh on a plane, another and a tetrahedron on it: contacts and accelerations."""
    more = """<body pos=".02 .03 .448" euler="0 0 20"><freejoint/><geom type="mesh" mesh="cube"/>
    </body><body pos="0 0 .597"><freejoint/><geom type="mesh" mesh="tetrahedron"/></body>"""
    model = jaxsim.load(scene('type="mesh" mesh="cube"', more))
    _, data = jaxsim.to_mujoco(model, jaxsim.make_state(model))
    result = quick_jit(jaxsim.forward)(model, jaxsim.make_state(model))
    near = np.asarray(result.contact.active)
    assert near.sum() == data.ncon
    assert data.ncon >= 11
    ours = np.sort(np.asarray(result.contact.dist)[near])
    np.testing.assert_allclose(ours, np.sort(data.contact.dist), atol=1e-6)


def test_meshes_that_do_not_collide_cost_nothing():
    model = jaxsim.load(scene('type="mesh" mesh="cube" contype="0" conaffinity="0"'))
    assert (model.geom_hull == -1).all()
    assert model.hull_corner.size == model.hull_ring.size == 0


def test_large_hulls_are_named_and_maxhullvert_holds():
    asset = f'<mesh name="ball" vertex="{ball(300)}" {{}}/>'
    with pytest.warns(UserWarning, match="'first'.*maxhullvert"):
        jaxsim.load(scene('type="mesh" mesh="ball"', asset=asset.format("")))
    model = jaxsim.load(scene('type="mesh" mesh="ball"', asset=asset.format('maxhullvert="20"')))
    assert model.hull_corner.shape[1] <= 20


def test_size_is_the_scale_of_a_mesh(x64):
    """Its derivative is that of the distance to the plane below."""
    model = jaxsim.load(scene('type="mesh" mesh="cube"'))
    state = jaxsim.make_state(model)
    upright = int(np.argmin(np.abs(model.geom_size[1] - 0.15)))  # of the mesh's principal axes

    def lowest(height):
        size = model.geom_size.at[1, upright].set(height)
        contact = jaxsim.forward(model.replace(geom_size=size), state).contact
        return jnp.min(contact.dist)

    value, slope = quick_jit(jax.value_and_grad(lowest))(0.2)
    np.testing.assert_allclose([value, slope], [0.149 - 0.2, -1], atol=1e-6)


def test_models_of_other_hulls_are_other_programs():
    first, second = (
        jaxsim.load(scene('type="mesh" mesh="body"', asset=f'<mesh name="body" vertex="{v}"/>'))
        for v in (ball(20), TETRAHEDRON)
    )
    assert first.structure != second.structure
    assert first.structure == jaxsim.load(first.structure.source).structure


def test_scale_does_not_go_back_to_mujoco():
    model = jaxsim.load(scene('type="mesh" mesh="cube"'))
    jaxsim.to_mujoco(model)
    with pytest.raises(jaxsim.ModelError, match="'first'.*mesh"):
        jaxsim.to_mujoco(model.replace(geom_size=model.geom_size * 2))


def test_corners_on_no_face_belong_to_the_hull():
    """On a lid, 20 corners protrude by so little that MuJoCo merges the triangles between them."""
    rng = np.random.default_rng(0)
    ring, inside = (
        0.1 * radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        for radius, angle in (
            (np.ones(12), np.sort(rng.uniform(0, 6.28, 12))),
            (0.8 * np.sqrt(rng.uniform(size=20)), rng.uniform(0, 6.28, 20)),
        )
    )
    domed = 0.05 + 1e-6 * (1 - 100 * np.sum(inside**2, axis=1))
    corners = [np.insert(ring, 2, -0.05, axis=1), np.insert(ring, 2, 0.05, axis=1)]
    points = np.concatenate([*corners, np.column_stack([inside, domed])])
    vertices = " ".join(f"{x:.9f}" for x in points.ravel())
    asset = f'<mesh name="drum" vertex="{vertices}"/>'
    model = jaxsim.load(scene('type="mesh" mesh="drum"', asset=asset))
    assert model.hull_size[0, 0] == 44
    assert model.hull_size[0, 1] < 20
