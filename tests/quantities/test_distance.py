"""Distances between geoms agree with `mj_geomDistance` and have derivatives."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

XML = """
<mujoco><asset><hfield name="f" nrow="2" ncol="2" size="1 1 1 1" elevation="0 0 0 0"/></asset>
<worldbody>
  <geom name="field" type="hfield" hfield="f" contype="0" conaffinity="0"/>
  <body><freejoint/><geom name="capsule" type="capsule" size=".1 .2"/></body>
  <body><freejoint/><geom name="box" type="box" size=".1 .2 .3"/></body>
  <body><freejoint/><geom name="other" type="box" size=".3 .1 .2"/></body>
</worldbody></mujoco>
"""
PAIRS = [("box", "capsule"), ("capsule", "box"), ("box", "other")]


def test_boxes_near_and_far_and_their_derivatives(rng, x64):
    mj = mujoco.MjModel.from_xml_string(XML)
    data, model = mujoco.MjData(mj), jaxsim.load(mj)
    state = jaxsim.make_state(model)
    weight = jnp.asarray(rng.normal(size=(2, 3)))

    def measure(qpos, size):
        moved = model.replace(geom_size=size), state.replace(qpos=qpos)
        return [jaxsim.geom_distance(*moved, *pair, 1.0) for pair in PAIRS]

    def score(qpos, size):
        return jnp.stack([d.distance + jnp.sum(weight * d.fromto) for d in measure(qpos, size)])

    step = jnp.asarray(rng.normal(size=mj.nq)), jnp.asarray(rng.normal(size=(mj.ngeom, 3)))
    both = quick_jit(lambda *at: (measure(*at), jax.jvp(score, at, step)))
    for k in range(12):
        bodies = data.qpos.reshape(-1, 7)
        bodies[:, :3] = (0.7 if k % 3 else 0.2) * rng.normal(size=(3, 3))
        bodies[:, 3:] = rng.normal(size=(3, 4))
        mujoco.mj_normalizeQuat(mj, data.qpos)
        mujoco.mj_forward(mj, data)
        at = jnp.asarray(data.qpos), model.geom_size
        found, (_, along) = both(*at)
        for pair, (distance, fromto) in zip(PAIRS, found, strict=True):
            segment = np.zeros(6)
            ids = [mj.geom(name).id for name in pair]
            expected = mujoco.mj_geomDistance(mj, data, *ids, 1.0, segment)
            np.testing.assert_allclose(distance, expected, atol=1e-9)
            if expected > 0:
                np.testing.assert_allclose(fromto.ravel(), segment, atol=1e-9)
        h = 1e-6
        up, down = (
            both(*(x + s * dx for x, dx in zip(at, step, strict=True)))[1][0] for s in (h, -h)
        )
        np.testing.assert_allclose(along, (up - down) / (2 * h), atol=1e-5, rtol=1e-5)


def test_what_has_no_distance_is_named():
    model = jaxsim.load(XML)
    state = jaxsim.make_state(model)
    with pytest.raises(jaxsim.ModelError, match="geom 'field': no distance"):
        jaxsim.geom_distance(model, state, "field", "box")
    with pytest.raises(IndexError, match="4 geoms, got number 4"):
        jaxsim.geom_distance(model, state, 0, 4)
