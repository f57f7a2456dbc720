"""A pair of shapes that the package does not have, added as `docs/extending.md` says."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from oracle import quick_jit

import jaxsim
from jaxsim.collision import PAIRS, Contacts, PairFunction
from jaxsim.collision.frames import tangent_of
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
