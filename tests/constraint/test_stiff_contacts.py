"""Contacts far stiffer than the bodies are heavy, in float32 as in float64."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.constraint.laws import ContactState
from jaxsim.constraint.laws.mujoco import contact_cost
from jaxsim.constraint.operators import factor

SLIPPERY = """
<mujoco>
  <option gravity="1 0 -9.81"/>
  <worldbody>
    <geom type="plane" size="2 2 1" friction="0"/>
    <body pos="0 0 .02"><freejoint/><geom type="box" size=".06 .05 .02" mass="1"/></body>
  </worldbody>
</mujoco>
"""


def _rollout(model, steps, state):
    step = lambda state, _: (jaxsim.step(model, state), None)  # noqa: E731
    return jax.lax.scan(step, state, None, length=steps)[0]


@pytest.mark.parametrize("double", [False, True])
def test_friction_of_every_size(double):
    """A box on a plane under a slanted gravity keeps its height, and slides as in MuJoCo.

    The edges of its friction pyramids weigh up to 10^10 times as much as the box.
    """
    mj, steps = mujoco.MjModel.from_xml_string(SLIPPERY), 60
    frictions = np.geomspace(1e-5, 1, 48)
    with jax.enable_x64(double):
        model = jaxsim.load(mj)
        state = jaxsim.make_state(model)

        def slide(friction):
            sliding = model.geom_friction.at[1, 0].set(friction)
            return _rollout(model.replace(geom_friction=sliding), steps, state).qpos

        found = np.asarray(quick_jit(jax.vmap(slide))(jnp.asarray(frictions)))
    for friction, qpos in zip(frictions, found, strict=True):
        mj.geom_friction[1, 0] = friction
        data = mujoco.MjData(mj)
        mujoco.mj_step(mj, data, steps)
        assert abs(qpos[2] - data.qpos[2]) < 1e-4, friction
        # MuJoCo's solver stops short of the friction of some of these steps.
        assert abs(qpos[0] - data.qpos[0]) < 1e-3, friction


@pytest.mark.parametrize(
    ("friction", "dist", "touches"),
    [
        (1e-4, -1e-9, True),
        (1e-4, 2e-7, True),
        (1e-4, 0.0, False),
        (1e-4, 1e-6, False),
        (1.0, 2e-7, False),
    ],
)
def test_a_stiff_contact_touches_as_far_as_rounding_reaches(friction, dist, touches):
    """Else it decides which corners of a resting box touch, and the box rolls over the others."""
    with jax.enable_x64(False):
        contact = ContactState(
            dist=jnp.float32(dist),
            includemargin=jnp.float32(0),
            rounding=jnp.float32(5e-7),
            velocity=jnp.zeros(3),
            inverse_weight=jnp.float32(1),
            friction=jnp.full(5, friction),
            solref=jnp.array([0.02, 1]),
            solreffriction=jnp.zeros(2),
            solimp=jnp.array([0.9, 0.95, 0.001, 0.5, 2]),
        )
        assert (contact_cost(jaxsim.load(SLIPPERY).opt, contact).D > 0) == touches


def test_a_hessian_that_rounding_spoils_is_still_factored():
    """`M + W n n^T`, W twice as large as float32 can hold beside M, in oblique directions n."""
    normals = np.random.default_rng(0).normal(size=(64, 12))
    H = np.eye(12) + 2 / np.finfo(np.float32).eps * normals[:, :, None] * normals[:, None]
    H = jnp.asarray(H, jnp.float32)
    assert jnp.isnan(jnp.linalg.cholesky(H)).any()
    factors = quick_jit(jax.vmap(factor))(jnp.concatenate([H, jnp.full((1, 12, 12), jnp.nan)]))
    assert jnp.isnan(jnp.diagonal(factors[-1])).all()
    product = factors[:-1] @ jnp.swapaxes(factors[:-1], 1, 2)
    largest = jnp.abs(H).max((1, 2), keepdims=True)
    np.testing.assert_allclose(product / largest, H / largest, atol=1e-5)


def test_without_friction_in_float64(x64, bundled):
    """States of a falling box that differ by rounding go on together.

    In a pyramidal cone friction 0, raised to MuJoCo's least 1e-5, makes the stiffest contacts.
    """
    mj = bundled("box_on_plane")
    mj.geom_friction[:] = 0
    model = jaxsim.load(mj)
    start = jaxsim.make_state(model)
    qpos = np.array([0.065, -0.037, 0.126, 0.8117, 0.312, 0.3628, 0.3351])
    qpos = qpos + 1e-9 * np.random.default_rng(0).normal(size=(64, 7))
    states = jax.vmap(lambda q: start.replace(qpos=q, qvel=start.qvel.at[0].set(1.0)))(qpos)
    found = quick_jit(jax.vmap(functools.partial(_rollout, model, 8)))(states).qvel
    for q, qvel in zip(qpos, np.asarray(found), strict=True):
        data = mujoco.MjData(mj)
        data.qpos[:], data.qvel[0] = q, 1.0
        mujoco.mj_step(mj, data, 8)
        np.testing.assert_allclose(qvel, data.qvel, atol=1e-3)
