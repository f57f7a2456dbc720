"""A pair of shapes that the package does not have, added as `docs/extending.md` says."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from oracle import quick_jit

import jaxsim
from jaxsim.collision import PAIRS, Contacts, PairFunction, detect, model_candidates
from jaxsim.collision.frames import tangent_of
from jaxsim.collision.pairs.capsule import sphere_sphere
from jaxsim.collision.table import SPHERE

HFIELD = int(mujoco.mjtGeom.mjGEOM_HFIELD)
VALLEY = """<mujoco><asset><hfield name="valley" nrow="2" ncol="2" size="1 1 1 .1"/></asset>
  <worldbody><geom type="hfield" hfield="valley"/><body pos="0 0 .28"><freejoint/>
  <geom size=".2" mass="1" condim="1"/></body></worldbody></mujoco>"""


def valley_sphere(valley, sphere):
    """Two contacts, with the planes `x + z = 0` and `z - x = 0`."""
    x, _, z = valley.mat.T @ (sphere.pos - valley.pos)
    normals = jnp.array([[1.0, 0, 1], [-1, 0, 1]]) / jnp.sqrt(2.0)
    dist = (jnp.stack([x, -x]) + z) / jnp.sqrt(2.0) - sphere.size[0]
    normals = normals @ valley.mat.T
    pos = sphere.pos[None] - normals * (sphere.size[0] + dist / 2)[:, None]
    return Contacts(dist, pos, normals, jax.vmap(tangent_of)(normals))


def test_a_ball_touches_both_sides_of_a_valley(monkeypatch):
    monkeypatch.setitem(PAIRS, (HFIELD, SPHERE), PairFunction(valley_sphere, 2))
    model = jaxsim.load(VALLEY)
    result = quick_jit(jaxsim.forward)(model, jaxsim.make_state(model))
    depth = 0.28 / np.sqrt(2) - 0.2
    np.testing.assert_allclose(result.contact.dist, depth, atol=1e-6)
    sides = np.asarray(result.contact.pos)
    np.testing.assert_allclose(sides[0], sides[1] * [-1, 1, 1], atol=1e-6)
    # Both push against gravity, and not sideways.
    np.testing.assert_allclose(result.qacc[:2], 0, atol=1e-4)
    assert result.qacc[2] > -9.0


def test_a_large_program_is_once_in_a_program_of_several_kinds(monkeypatch):
    """Spheres in a row with different condims have the same contacts."""
    traced = []

    def counted(first, second):
        traced.append(1)
        return sphere_sphere(first, second)

    row = "".join(
        f'<body pos="{x} 0 0"><freejoint/><geom size=".11" condim="{dim}"/></body>'
        for x, dim in ((0, 1), (0.2, 3), (0.41, 4), (0.63, 6))
    )
    model = jaxsim.load(f"<mujoco><worldbody>{row}</worldbody></mujoco>")
    found = []
    for large in (False, True):
        traced.clear()
        monkeypatch.setitem(PAIRS, (SPHERE, SPHERE), PairFunction(counted, 1, large))
        pos, mat = model.body_pos[1:], jnp.broadcast_to(jnp.eye(3), (4, 3, 3))
        contact = detect(model, model_candidates(model), pos, mat)
        found.append(np.concatenate([contact.dist[:, None], contact.pos], axis=1))
        assert len(traced) == (1 if large else len(contact.ranges))
    assert len(contact.ranges) == 3
    np.testing.assert_array_equal(*found)
    np.testing.assert_allclose(np.sort(found[0][:, 0])[:3], [-0.02, -0.01, 0], atol=1e-6)
