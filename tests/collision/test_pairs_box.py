"""Boxes: manifolds whose corners are known."""

import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

from jaxsim.collision import Shape
from jaxsim.collision.pairs.box import capsule_box, sphere_box
from jaxsim.collision.pairs.box_box import box_box

box_box = quick_jit(box_box)


def place(pos=(0, 0, 0), angle=0.0, axis="z", size=(0.1, 0.1, 0.1)):
    c, s = np.cos(angle), np.sin(angle)
    turn = {"z": [[c, -s, 0], [s, c, 0], [0, 0, 1]], "x": [[1, 0, 0], [0, c, -s], [0, s, c]]}
    return Shape(*(jnp.asarray(v, float) for v in (pos, turn[axis], size)))


def touching(contacts):
    return np.asarray(contacts.pos)[np.asarray(contacts.dist) < 0.5]


def sorted_rows(x):
    return np.array(sorted(np.round(x, 9).tolist()))


@pytest.mark.parametrize("offset", [(0, 0), (0.05, 0), (0.05, -0.03), (0.15, 0)])
def test_equal_boxes_touch_at_the_corners_of_the_overlap(offset):
    """Where edges of both lie on each other no corner is there twice."""
    contacts = box_box(place(), place((*offset, 0.19)))
    ends = [sorted([max(-0.1, x - 0.1), min(0.1, x + 0.1)]) for x in offset]
    expected = [[x, y, 0.095] for x in ends[0] for y in ends[1]]
    np.testing.assert_allclose(sorted_rows(touching(contacts)), sorted_rows(expected), atol=1e-8)
    np.testing.assert_allclose(contacts.normal, [[0, 0, 1]], atol=1e-12)


def test_turned_by_45_degrees_they_touch_at_an_octagon():
    contacts = box_box(place(), place((0, 0, 0.19), np.pi / 4))
    pos = touching(contacts)
    angles = np.sort(np.arctan2(pos[:, 1], pos[:, 0]))
    np.testing.assert_allclose(np.diff(angles), np.pi / 4, atol=0.1)
    np.testing.assert_allclose(np.abs(pos[:, :2]).max(axis=1), 0.1, atol=1e-12)
    np.testing.assert_allclose(contacts.dist, -0.01, atol=1e-12)


def test_crossing_edges_touch_at_one_point():
    lower = place(angle=np.pi / 4, axis="x", size=(0.3, 0.1, 0.1))
    turn = jnp.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    height = 2 * np.sqrt(0.02) - 0.01
    upper = lower.replace(mat=turn @ lower.mat, pos=jnp.array([0.02, 0.03, height]))
    contacts = box_box(lower, upper)
    np.testing.assert_allclose(touching(contacts), [[0.02, 0, height / 2]], atol=1e-12)
    np.testing.assert_allclose(contacts.dist[0], -0.01, atol=1e-12)


def test_capsule_over_the_rim_of_a_box():
    """It lies along x, one end beyond the face: contacts at its end and where the face ends."""
    axis = jnp.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])
    capsule = Shape(jnp.array([0.15, 0.02, 0.14]), axis, jnp.array([0.05, 0.1, 0]))
    contacts = capsule_box(capsule, place())
    np.testing.assert_allclose(contacts.dist, -0.01, atol=1e-12)
    np.testing.assert_allclose(np.sort(contacts.pos[:, 0]), [0.05, 0.1], atol=1e-9)


@pytest.mark.parametrize(("x", "normal"), [(0.02, 1), (-0.02, -1), (0.0, -1)])
def test_sphere_inside_a_box_is_pushed_out_of_the_closest_face(x, normal):
    sphere = Shape(jnp.array([x, 0.0, 0]), jnp.eye(3), jnp.array([0.01, 0, 0]))
    contacts = sphere_box(sphere, place(size=(0.05, 0.1, 0.2)))
    np.testing.assert_allclose(contacts.normal[0], [-normal, 0, 0], atol=1e-12)
    np.testing.assert_allclose(contacts.dist, -(0.05 - abs(x)) - 0.01, atol=1e-12)
