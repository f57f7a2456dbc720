"""The search for the largest separation, where it has several local maxima."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from oracle import quick_jit
from pair_sizes import hulls
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from jaxsim.collision import Shape
from jaxsim.collision.convex.polytope import Polytope
from jaxsim.collision.convex.search import search
from jaxsim.collision.convex.solid_pair import SolidPair

N = 800


def test_the_least_depth_of_deep_polytopes_is_found(rng):
    """Beside the exact one, that of the faces of the Minkowski difference: 99 per cent of poses."""
    corners = rng.normal(size=(2, 12, 3))
    corners *= 0.12 / np.linalg.norm(corners, axis=2, keepdims=True)
    meshes = (" ".join(f"{x:.6f}" for x in c.ravel()) for c in corners)
    one, two = (f'<mesh name="{n}" vertex="{v}"/>' for n, v in zip("ab", meshes, strict=True))
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset>{one}{two}</asset><worldbody><geom type="mesh" mesh="a"/>
        <geom type="mesh" mesh="b"/></worldbody></mujoco>"""
    )
    first, second = (
        lambda pos, mat, s=size, h=hull: Polytope(Shape(pos, mat, jnp.asarray(s), h))
        for size, hull in zip(model.geom_size, hulls(model), strict=True)
    )
    here = first(jnp.zeros(3), jnp.eye(3))
    mats = Rotation.from_quat(rng.normal(size=(N, 4))).as_matrix()
    along = rng.normal(size=(N, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    pos, depths = np.zeros((N, 3)), rng.uniform(0.005, 0.05, N)
    for k, (mat, direction, depth) in enumerate(zip(mats, along, depths, strict=True)):
        there = np.asarray(second(jnp.zeros(3), jnp.eye(3)).corner) @ mat.T
        minkowski = ConvexHull((there[:, None] - np.asarray(here.corner)[None]).reshape(-1, 3))
        normal, offset = np.split(minkowski.equations, [3], axis=1)
        # Moved by t along the direction, the face i is n_i . t - offset_i from the origin.
        slope, room = normal @ direction, -offset[:, 0] - depth
        pos[k] = direction * np.min(room[slope < 0] / -slope[slope < 0])
    separation = quick_jit(jax.vmap(lambda p, m: search(SolidPair(here, second(p, m))).separation))
    missed = -np.asarray(separation(pos, mats)) - depths
    assert missed.min() > -1e-12
    assert np.mean(missed > 1e-6) < 0.01
    assert np.mean(missed > 1e-3) < 0.002
