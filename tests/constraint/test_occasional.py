"""Rows that couple moving links, in batches where they push nowhere, somewhere and everywhere."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

BALLS = """
<mujoco><option cone="{cone}"/><worldbody>
  <geom type="plane" size="1 1 1" condim="3"/>
  <body name="a"><joint name="a" type="slide" axis="0 0 1"/><joint type="slide" axis="1 0 0"/>
    <geom size=".1" condim="{condim}"/></body>
  <body name="b"><joint name="b" type="slide" axis="0 0 1"/><joint type="hinge" axis="1 0 0"/>
    <geom size=".1" condim="{condim}"/></body>
</worldbody></mujoco>
"""

# Heights of both balls: apart and in the air, on the ground with the other far, one on the other.
HEIGHTS = np.array([[0.5, 1.0], [0.099, 0.6], [0.098, 0.295], [0.35, 0.54]])
PUSHES = np.array([False, False, True, True])

# Both sides converge; what remains is rounding of the two ways to solve.
RTOL, ATOL = 1e-9, 1e-8


def batch(model, heights):
    state = jaxsim.make_state(model)
    z = jnp.asarray(heights)
    qpos = jnp.zeros((len(heights), 4)).at[:, 0].set(z[:, 0]).at[:, 2].set(z[:, 1])
    qvel = jnp.broadcast_to(jnp.array([0.1, 0.4, -0.3, 1.0]), qpos.shape)
    return jax.vmap(lambda q, v: state.replace(qpos=q, qvel=v))(qpos, qvel)


def load(hessian, cone="elliptic", condim=3):
    return jaxsim.load(BALLS.format(cone=cone, condim=condim), hessian=hessian)


@functools.cache
def forward(hessian, vmap=lambda f: f):
    """Function from states to their accelerations and constraint forces."""
    model = load(hessian)
    return quick_jit(vmap(lambda s: jaxsim.forward(model, s, jnp.zeros(0))))


@functools.cache
def forward_alone(hessian):
    """Accelerations and constraint forces of every state, one after the other."""
    alone, states = forward(hessian), batch(load(hessian), HEIGHTS)
    return [alone(jax.tree.map(lambda x, i=i: x[i], states)) for i in range(len(HEIGHTS))]


def qvel_after(model, qvel, state):
    return jaxsim.step(model, state.replace(qvel=qvel)).qvel


@functools.cache
def jacobians_alone():
    """`d qvel_after / d qvel` of every state, one after the other."""
    model = load("dense")
    alone = quick_jit(jax.jacfwd(functools.partial(qvel_after, model)))
    states = batch(model, HEIGHTS)
    each = [jax.tree.map(lambda x, i=i: x[i], states) for i in range(len(HEIGHTS))]
    return [alone(s.qvel, s) for s in each]


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(
    ("vmap", "hessian"),
    [
        (jax.vmap, "dense"),
        (jaxsim.vmap, "iterative"),
        pytest.param(jax.vmap, "iterative", marks=pytest.mark.slow),
        pytest.param(jaxsim.vmap, "dense", marks=pytest.mark.slow),
    ],
)
@pytest.mark.parametrize("chosen", [[0, 1], [2, 3], [0, 1, 2, 3]])
def test_each_as_alone(vmap, hessian, chosen):
    """An environment moves as it does alone, whatever the others meet."""
    together = forward(hessian, vmap)(batch(load(hessian), HEIGHTS[chosen]))
    pushed = jnp.abs(together.contact.force[..., 0]).max(-1) > 0
    assert (pushed | ~PUSHES[chosen]).all()
    for i, place in enumerate(chosen):
        alone = forward_alone(hessian)[place]
        np.testing.assert_allclose(together.qacc[i], alone.qacc, rtol=RTOL, atol=ATOL)
        np.testing.assert_allclose(
            together.qfrc_constraint[i], alone.qfrc_constraint, rtol=RTOL, atol=ATOL
        )


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize(
    ("cone", "condim"),
    [("pyramidal", 3), pytest.param("elliptic", 4, marks=pytest.mark.slow), ("elliptic", 1)],
)
def test_strategies_agree(cone, condim):
    models = [load(hessian, cone, condim) for hessian in ("dense", "iterative")]
    dense, iterative = (
        quick_jit(jaxsim.vmap(lambda s, m=m: jaxsim.forward(m, s, None).qacc))(batch(m, HEIGHTS))
        for m in models
    )
    np.testing.assert_allclose(dense, iterative, rtol=1e-7, atol=1e-7)


@pytest.mark.usefixtures("x64")
@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
@pytest.mark.parametrize("derivative", [jax.jacfwd, jax.jacrev])
def test_derivatives_as_alone(vmap, derivative):
    model = load("dense")
    together = quick_jit(vmap(derivative(functools.partial(qvel_after, model))))
    for chosen in ([0, 1], [0, 2]):
        states = batch(model, HEIGHTS[chosen])
        found = together(states.qvel, states)
        for i, place in enumerate(chosen):
            np.testing.assert_allclose(found[i], jacobians_alone()[place], rtol=RTOL, atol=ATOL)
