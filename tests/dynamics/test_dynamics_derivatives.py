"""Derivatives of the dynamics in both modes against central differences, singular points too."""

import types

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit
from random_models import random_model, random_states

from jaxsim.dynamics.aba import solve_mass
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.rnea import qfrc_bias
from jaxsim.dynamics.velocity import velocities
from jaxsim.io import load
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.quantities.energy import joint_spring_energy, kinetic_energy, potential_energy

# What is differentiated; the first is a displacement in the tangent space of qpos.
LEAVES = (
    "body_mass body_inertia body_pos body_quat body_ipos body_iquat jnt_pos dof_armature".split()
)
INPUTS = ["qpos", "qvel", "gravity", "force", *LEAVES]
STATES = ["random", "at rest without rotation", "rotated by pi"]
STEP = 1e-6


# Every joint type; a spring deflected by exactly pi has no derivative.
_XML = random_model(3, bodies=4, multiple=False, stiffness=False)


@pytest.fixture(scope="module")
def derivatives() -> types.SimpleNamespace:
    """Outputs' derivatives along one random direction per input, at every state."""
    with jax.enable_x64(True):
        mj = mujoco.MjModel.from_xml_string(_XML)
        model = load(mj)
        states = _states(mj)
        compute = jax.vmap(_derivatives, in_axes=(None, 0, 0))
        record = quick_jit(compute)(model, *states)
    return types.SimpleNamespace(**jax.tree.map(np.asarray, record))


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("name", INPUTS)
def test_forward_mode_is_the_central_difference(derivatives, name, state):
    i, k = STATES.index(state), INPUTS.index(name)
    exact, difference = derivatives.forward[i, k], derivatives.difference[i, k]
    assert state != "random" or np.linalg.norm(difference) > 1e-3
    np.testing.assert_allclose(exact, difference, atol=1e-6 * np.linalg.norm(difference) + 1e-7)


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("name", INPUTS)
def test_reverse_mode_is_the_transpose_of_forward_mode(derivatives, name, state):
    i, k = STATES.index(state), INPUTS.index(name)
    forward = derivatives.forward[i, k] @ derivatives.cotangent[i]
    np.testing.assert_allclose(derivatives.reverse[i, k], forward, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("joint", ["ball", "free"])
def test_springs_have_two_derivatives_where_they_are_slack(joint):
    """The potential of a spring at rest is `k x^2 / 2` in each direction."""
    xml = f"""<mujoco><worldbody><body><joint type="{joint}" stiffness="3 2 1"/><geom size="1"/>
      </body></worldbody></mujoco>"""
    model = load(xml)

    def energy(dq):
        return joint_spring_energy(model, integrate_pos(model, model.qpos0, dq, 1.0))

    zero = jnp.zeros(model.nv)
    gradient, hessian = quick_jit(lambda x: (jax.grad(energy)(x), jax.hessian(energy)(x)))(zero)
    np.testing.assert_allclose(gradient, zero, atol=1e-12)
    np.testing.assert_allclose(hessian, 3 * np.eye(model.nv), atol=1e-9)


def _states(mj) -> tuple[np.ndarray, np.ndarray]:
    qpos, qvel = random_states(mj, seed=0, n=len(STATES))
    qpos[1:], qvel[1] = mj.qpos0, 0
    quaternions = np.isin(mj.jnt_type, (mujoco.mjtJoint.mjJNT_FREE, mujoco.mjtJoint.mjJNT_BALL))
    for j in np.nonzero(quaternions)[0]:
        start = mj.jnt_qposadr[j] + 3 * (mj.jnt_type[j] == mujoco.mjtJoint.mjJNT_FREE)
        qpos[1, start : start + 4] = 1, 0, 0, 0
        qpos[2, start : start + 4] = 0, 0.6, 0, 0.8
    return qpos, qvel


def _derivatives(model, qpos, qvel):
    inputs = _inputs(model, qvel)
    f = lambda x: _outputs(model, qpos, x)  # noqa: E731
    directions = _directions(inputs)
    value, pullback = jax.vjp(f, inputs)
    cotangent = jnp.asarray(np.random.default_rng(1).standard_normal(value.shape))
    (gradient,) = pullback(cotangent)

    def moved(direction, step):
        return f(jax.tree.map(lambda x, d: x + step * d, inputs, direction))

    return {
        "forward": jax.vmap(lambda d: jax.jvp(f, (inputs,), (d,))[1])(directions),
        "reverse": jax.vmap(lambda d: _dot(gradient, d))(directions),
        "difference": jax.vmap(lambda d: (moved(d, STEP) - moved(d, -STEP)) / (2 * STEP))(
            directions
        ),
        "cotangent": cotangent,
    }


def _inputs(model, qvel):
    inputs = {name: getattr(model, name) for name in LEAVES}
    force = jnp.asarray(np.random.default_rng(0).standard_normal(model.nv))
    return inputs | {
        "qpos": jnp.zeros(model.nv),
        "qvel": qvel,
        "gravity": model.opt.gravity,
        "force": force,
    }


def _outputs(model, qpos, x):
    """Accelerations, centre of mass and energies, as functions of everything."""
    leaves = {name: x[name] for name in LEAVES}
    model = model.replace(opt=model.opt.replace(gravity=x["gravity"]), **leaves)
    qpos = integrate_pos(model, qpos, x["qpos"], 1.0)
    kin = kinematics(model, qpos)
    vel = velocities(model, kin, x["qvel"])
    qacc = solve_mass(model, kin, x["force"] - qfrc_bias(model, kin, vel))
    energy = kinetic_energy(model, kin, vel, x["qvel"]), potential_energy(model, kin, qpos)
    return jnp.concatenate([qacc, kin.subtree_com[0], jnp.stack(energy)])


def _directions(inputs):
    """Stacked directions: one input at a time moves, in proportion to its size."""
    rng = np.random.default_rng(2)
    directions = {}
    for name, x in inputs.items():
        rows = np.zeros((len(INPUTS), *x.shape))
        rows[INPUTS.index(name)] = rng.standard_normal(x.shape)
        scale = x if name in ("body_mass", "body_inertia") else 0.3
        directions[name] = jnp.asarray(rows) * jnp.broadcast_to(scale, x.shape)[None]
    return directions


def _dot(a, b):
    return sum(jax.tree.leaves(jax.tree.map(lambda x, y: (x * y).sum(), a, b)))
