"""Derivatives of one step are those of the program: automatic ones equal differences, in float64.

They exist everywhere: at touchdown, lift-off, rest and every other corner there is no NaN.
"""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from instants import batch_states, converging, evaluated, rollout, stepped
from oracle import quick_jit

from jaxsim.engine.stepping import step
from jaxsim.io import bundled_models, load
from jaxsim.joints.coordinates import difference_pos, integrate_pos
from jaxsim.model import make_state

# Every condim, free bodies that stick, slide, spin and roll.
CONTACTS = """
<mujoco>
  <option timestep="0.002" impratio="2"/>
  <default><geom contype="0" solimp=".8 .95 .005"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1" contype="1" friction=".4 .005 .0001"/>
    <body pos="0 0 .1"><freejoint/><geom type="sphere" size=".1" condim="1"/></body>
    <body pos="1 0 .1"><freejoint/><geom type="box" size=".12 .09 .1" friction=".3 .1 .1"/></body>
    <body pos="2 0 .1"><freejoint/>
      <geom type="sphere" size=".1" condim="4" friction=".6 .02 .001"/></body>
    <body pos="3 0 .1"><freejoint/>
      <geom type="capsule" size=".1 .2" condim="6" friction=".5 .03 .02" euler="90 0 0"/></body>
  </worldbody>
</mujoco>
"""
# One of each kind of row with few degrees of freedom, and a motor.
SMALL = """
<mujoco>
  <option timestep="0.002" cone="elliptic"/>
  <default><geom contype="0" solimp=".8 .95 .005"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1" contype="1" friction=".4 .005 .0001"/>
    <body pos="0 0 .098"><joint name="x" type="slide" axis="1 0 0"/>
      <joint name="z" type="slide" axis="0 0 1"/>
      <joint name="turn" axis="0 1 0" limited="true" range="-1 1" frictionloss=".05"/>
      <geom type="sphere" size=".1" pos="0.01 0 0"/></body>
  </worldbody>
  <actuator><motor joint="x" gear="8"/><motor joint="turn" gear=".2"/></actuator>
</mujoco>
"""
LEAVES = ("body_mass", "geom_friction", "geom_size", "geom_solref", "geom_pos")


@pytest.fixture(autouse=True)
def float64(x64):
    """Differences need digits."""


def flat_step(model, state, ctrl, about=None):
    """A step as a function of one vector: tangent of qpos, qvel, ctrl and leaves of the model.

    The result is the next qpos in the tangent space at `about`, or at the state, and qvel.
    """
    about = state.qpos if about is None else about
    leaves = [getattr(model, name) for name in LEAVES]
    parts = [jnp.zeros(model.nv), state.qvel, ctrl, *[leaf.ravel() for leaf in leaves]]
    cuts = np.cumsum([p.size for p in parts])[:-1]

    def f(x):
        move, qvel, ctrl, *values = jnp.split(x, cuts)
        changed = {n: v.reshape(a.shape) for n, v, a in zip(LEAVES, values, leaves, strict=True)}
        qpos = integrate_pos(model, state.qpos, move, 1.0)
        after = step(model.replace(**changed), state.replace(qpos=qpos, qvel=qvel), ctrl)
        moved = difference_pos(model, about, after.qpos)
        return jnp.concatenate([moved, after.qvel])

    return f, jnp.concatenate(parts)


def jacobians(model, states, ctrl, about):
    """One Jacobian for each state, by forward mode."""

    def one(*inputs):
        f, x = flat_step(model, *inputs)
        return jax.jacfwd(f)(x)

    return np.asarray(quick_jit(jax.vmap(one))(states, ctrl, about))


def differences(model, states, ctrl, about, h=1e-6):
    """The same by five-point central differences of the compiled step."""

    def value(state, ctrl, about, dx):
        f, x = flat_step(model, state, ctrl, about)
        return f(x + dx)

    n = flat_step(model, jax.tree.map(lambda x: x[0], states), ctrl[0])[1].size
    shifts = jnp.asarray(np.concatenate([k * h * np.eye(n) for k in (-2, -1, 1, 2)]))
    every = quick_jit(jax.vmap(jax.vmap(value, (None, None, None, 0)), (0, 0, 0, None)))
    y = np.asarray(every(states, ctrl, about, shifts)).reshape(len(ctrl), 4, n, -1)
    slope = (y[:, 0] - 8 * y[:, 1] + 8 * y[:, 2] - y[:, 3]) / (12 * h)
    return slope.transpose(0, 2, 1)


def assert_same(actual, expected, rtol):
    for a, e in zip(actual, expected, strict=True):
        np.testing.assert_allclose(a, e, atol=rtol * max(1.0, np.abs(e).max()))


@pytest.mark.parametrize("cone", ["pyramidal", pytest.param("elliptic", marks=pytest.mark.slow)])
def test_contacts_of_every_dimension(cone, rng):
    """Case G18: sticking, slipping and in between; both modes, and MuJoCo's own differences."""
    mj = converging(CONTACTS, cone)
    datas = _rest_slip_and_bounce(mj, rng)
    model = load(mj)
    states, ctrl = batch_states(model, datas)
    about = jnp.stack([stepped(mj, d).qpos for d in datas])
    slopes = jacobians(model, states, ctrl, about)
    assert_same(slopes, differences(model, states, ctrl, about), 1e-6)
    for slope, data in zip(slopes, datas, strict=True):
        theirs = np.zeros((2 * mj.nv, 2 * mj.nv))
        mujoco.mjd_transitionFD(mj, data, 1e-6, True, theirs, None, None, None)
        error = np.abs(slope[:, : 2 * mj.nv] - theirs).max()
        assert error < 1e-5 * np.abs(theirs).max()
    if cone == "elliptic":
        _assert_reverse_mode(model, states, ctrl, about, slopes, rng)


def _assert_reverse_mode(model, states, ctrl, about, slopes, rng):
    weight = jnp.asarray(rng.normal(size=2 * model.nv))

    def pulled(*inputs):
        f, x = flat_step(model, *inputs)
        return jax.grad(lambda x: weight @ f(x))(x)

    got = quick_jit(jax.vmap(pulled))(states, ctrl, about)
    assert_same(got, weight @ slopes, 1e-10)


@pytest.mark.slow
def test_neither_strategy_nor_iterations_change_derivatives(rng):
    mj = converging(SMALL)
    datas, model = rollout(mj, 6, 20, seed=5), load(mj)
    states, ctrl = batch_states(model, datas)
    states = states.replace(qacc_warmstart=jnp.stack([d.qacc for d in datas]))

    def one(model, state, ctrl):
        f, x = flat_step(model, state, ctrl)
        return jax.jacfwd(f)(x)

    variants = {name: model.replace(hessian=name) for name in ("dense", "iterative")}
    variants["one iteration"] = model.replace(opt=model.opt.replace(iterations=1))

    def every(state, ctrl):
        return {name: one(m, state, ctrl) for name, m in (variants | {"auto": model}).items()}

    slopes = quick_jit(jax.vmap(every))(states, ctrl)
    for name in variants:
        assert_same(slopes[name], slopes["auto"], 1e-8)
    assert_same(slopes["auto"], differences(model, states, ctrl, states.qpos), 1e-6)


def test_hessian_of_a_step(rng):
    """Second derivatives exist where the first ones are smooth."""
    mj = converging(SMALL)
    data = rollout(mj, 5, 20, seed=5)[-1]
    model = load(mj)
    states, ctrl = batch_states(model, [data])
    state, ctrl = jax.tree.map(lambda x: x[0], (states, ctrl))
    weight = jnp.asarray(rng.normal(size=2 * mj.nv))
    n = mj.nv + mj.nu

    def loss(y):
        qvel, act = state.qvel + y[: mj.nv], ctrl + y[mj.nv :]
        after = step(model, state.replace(qvel=qvel), act)
        return weight @ jnp.concatenate([after.qpos, after.qvel])

    h = 1e-5
    curvature = quick_jit(jax.hessian(loss))(jnp.zeros(n))
    gradient = quick_jit(jax.vmap(jax.grad(loss)))
    both = [gradient(sign * h * jnp.eye(n)) for sign in (1, -1)]
    expected = (both[0] - both[1]) / (2 * h)
    assert np.abs(expected).max() > 1e-4
    np.testing.assert_allclose(curvature, expected, atol=1e-5 * np.abs(expected).max())


# Sizes and places are exact in binary, so that distances can be exactly zero.
CORNERS = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <geom type="plane" size="0 0 1" friction="0 0 0"/>
    <body pos="0 0 .125"><freejoint/>
      <geom type="sphere" size=".125" condim="6" friction="0 0 0" contype="0"/></body>
    <body pos="2 0 .125"><freejoint/><geom type="box" size=".125 .125 .125" margin=".0625"
      contype="0" friction=".5 .1 .1"/></body>
    <body pos="4 0 1"><freejoint/>
      <geom type="sphere" size=".125" contype="2" conaffinity="3"/></body>
    <body pos="5 0 1"><freejoint/>
      <geom type="sphere" size=".125" contype="2" conaffinity="3"/></body>
    <body pos="0 0 2"><joint type="ball" limited="true" range="0 45"/>
      <geom type="capsule" fromto="0 0 0 .25 0 0" size=".05" contype="0" conaffinity="0"/>
      <body pos=".25 0 0"><joint axis="0 1 0" limited="true" range="-30 0" frictionloss=".1"/>
        <geom type="capsule" fromto="0 0 0 .25 0 0" size=".05" contype="0" conaffinity="0"/>
    </body></body>
  </worldbody>
</mujoco>
"""


@pytest.mark.parametrize("cone", [pytest.param("pyramidal", marks=pytest.mark.slow), "elliptic"])
def test_no_nan_at_corners(cone):
    model = load(converging(CORNERS, cone))
    states, ctrl = _corners(model)

    def one(state, ctrl):
        f, x = flat_step(model, state, ctrl)
        y, pull = jax.vjp(f, x)
        return y, pull(jnp.ones_like(y)), jax.jvp(f, (x,), (jnp.ones_like(x),))[1]

    for values in quick_jit(jax.vmap(one))(states, ctrl):
        assert np.isfinite(values).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ant", "humanoid", "hopper"])
def test_robots_on_their_feet(name, bundled):
    mj = converging(bundled(name))
    datas, model = rollout(mj, 5, 100, seed=1), load(mj)
    datas = [d for d in datas if d.ncon][:2]
    assert datas
    states, ctrl = batch_states(model, datas)
    inputs = model, states, ctrl, states.qpos
    assert_same(jacobians(*inputs), differences(*inputs), 1e-6)


def _rest_slip_and_bounce(mj, rng):
    """Bodies at rest; sliding, spinning and rolling; tilted, partly in contact."""
    data, found = mujoco.MjData(mj), []
    for _ in range(400):
        mujoco.mj_step(mj, data)
    for speed in (1e-3, 1.0):
        other = evaluated(mj, data)
        other.qvel[:] += speed * rng.normal(size=mj.nv) * np.tile([1, 1, 0.01, 1, 1, 3], 4)
        other.qpos[:] = data.qpos
        found.append(evaluated(mj, other))
    tilted = evaluated(mj, found[-1])
    mujoco.mj_integratePos(mj, tilted.qpos, 2e-3 * rng.normal(size=mj.nv), 1.0)
    return [*found, evaluated(mj, tilted)]


def _corners(model):
    """States at which something changes: contact, slip, limits, coincidence; and nothing near."""
    start = make_state(model)
    touching = start
    at_margin = start.replace(qpos=start.qpos.at[9].set(0.125 + 0.0625))
    pressed = start.replace(qpos=start.qpos.at[np.array([2, 9])].add(-1e-3))
    leaving = pressed.replace(qvel=start.qvel.at[np.array([2, 8])].set(5.0))
    sliding = pressed.replace(qvel=start.qvel.at[np.array([0, 6])].set(1.0))
    coincident = start.replace(qpos=start.qpos.at[21].set(start.qpos[14]))
    nothing = start.replace(qpos=start.qpos.at[np.array([2, 9, 16, 23])].set(5.0))
    turned = start.qpos.at[-5:-1].set(jnp.array([0.8, 0.6, 0, 0]))
    beyond = start.replace(qpos=turned.at[-1].set(0.1))
    states = [touching, at_margin, pressed, leaving, sliding, coincident, nothing, beyond]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *states)
    return batch, jnp.zeros((len(states), model.nu))


@pytest.mark.parametrize("name", bundled_models())
def test_reverse_mode_of_every_bundled_model_traces(name):
    """Linear solves are recognised as such for all joints and strategies."""
    model = load(name)
    model = model.replace(opt=model.opt.replace(integrator=int(mujoco.mjtIntegrator.mjINT_EULER)))

    def height(qvel):
        return step(model, make_state(model).replace(qvel=qvel)).qpos.sum()

    jax.make_jaxpr(jax.grad(height))(jnp.ones(model.nv))
