"""`step`, `rollout` and their batches: against MuJoCo, with every integrator, and as functions."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from instants import batch_states, converging, rollout, stepped
from oracle import assert_close, quick_jit

import jaxsim
from jaxsim.engine.stepping import step
from jaxsim.io import bundled_models, load
from jaxsim.model import make_state

# Contacts of several condims, limits, dry friction, filters, springs, a free and a ball joint.
ROBOT = """
<mujoco>
  <option timestep="0.002"/>
  <default><geom contype="0" friction=".8 .02 .01"/>
    <joint limited="true" range="-40 40" damping=".3" armature=".01"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1" contype="1"/>
    <body pos="0 0 .35"><freejoint/><geom type="box" size=".15 .1 .05" mass="2"/>
      <body pos=".15 .1 0"><joint name="a" axis="0 1 0" frictionloss=".1"/>
        <geom type="capsule" fromto="0 0 0 .1 .05 -.3" size=".04" mass=".4" condim="6"/></body>
      <body pos=".15 -.1 0"><joint name="b" axis="1 1 0" stiffness="5"/>
        <geom type="capsule" fromto="0 0 0 .1 -.05 -.3" size=".04" mass=".4" condim="3"/></body>
      <body pos="-.15 0 0"><joint type="ball" range="0 50"/>
        <geom type="capsule" fromto="0 0 0 -.1 0 -.3" size=".04" mass=".4" condim="4"/></body>
    </body>
  </worldbody>
  <actuator><motor joint="a" gear="3"/>
    <general joint="b" dyntype="filterexact" dynprm=".05" gainprm="4" biastype="affine"
      biasprm="0 -2 -.5"/></actuator>
</mujoco>
"""
INTEGRATORS = {
    name: int(getattr(mujoco.mjtIntegrator, f"mjINT_{name}"))
    for name in "EULER IMPLICITFAST IMPLICIT RK4".split()
}
# What has constraints and is quick to compile.
DEFAULT_BUNDLED = ("box_on_plane", "half_cheetah")


@pytest.mark.parametrize(
    "integrators",
    [("EULER", "IMPLICITFAST"), pytest.param(("IMPLICIT", "RK4"), marks=pytest.mark.slow)],
)
def test_one_step_with_every_integrator(integrators, x64):
    """The states before each step of a MuJoCo rollout, as one batch."""
    mj = converging(ROBOT, "elliptic")
    datas, model = rollout(mj, 12, 25, seed=3), load(mj)
    states, ctrl = batch_states(model, datas)

    def steps(state, ctrl):
        options = {n: model.opt.replace(integrator=INTEGRATORS[n]) for n in integrators}
        return {name: step(model.replace(opt=o), state, ctrl) for name, o in options.items()}

    got = quick_jit(jax.vmap(steps))(states, ctrl)
    for name, state in got.items():
        after = [stepped(mj, d, INTEGRATORS[name]) for d in datas]
        # Runge-Kutta averages rotations as a Lie group should: MuJoCo's are off by order h^3.
        tolerance = 1e-7 if name == "RK4" else 1e-8
        for field in ("qpos", "qvel", "act", "time"):
            expected = np.stack([getattr(d, field) for d in after])
            assert_close(getattr(state, field), expected, tolerance, tolerance, f"{name} {field}")


@pytest.mark.slow
def test_divergence_is_not_faster_than_chaos(x64):
    mj = converging(ROBOT, "elliptic")
    start = rollout(mj, 2, 150, seed=3)[-1]
    model, steps = load(mj), 150
    rng = np.random.default_rng(0)
    ctrls = rng.uniform(-1, 1, (steps, mj.nu))
    states, _ = batch_states(model, [start])
    state = jax.tree.map(lambda x: x[0], states)
    _, ours = quick_jit(jaxsim.rollout)(model, state, jnp.asarray(ctrls))
    theirs = _mujoco_rollout(mj, start, ctrls)
    nudged = mujoco.MjData(mj)
    mujoco.mj_copyData(nudged, mj, start)
    mujoco.mj_integratePos(mj, nudged.qpos, 1e-7 * rng.standard_normal(mj.nv), 1.0)
    chaos = np.abs(_mujoco_rollout(mj, nudged, ctrls) - theirs).max(1)
    error = np.abs(np.asarray(ours.qpos) - theirs).max(1)
    assert (error <= 3 * np.maximum.accumulate(chaos)).all()


def test_no_controls_are_zero_controls():
    model = load(LIMITED)
    state = make_state(model)
    with_zeros, without = quick_jit(
        lambda s: (step(model, s, jnp.zeros(model.nu)), step(model, s)),
    )(state)
    np.testing.assert_array_equal(with_zeros.qpos, without.qpos)
    np.testing.assert_allclose(without.time, model.opt.timestep)


@pytest.mark.parametrize(
    ("field", "shape"),
    [
        ("qpos", (3,)),
        ("qvel", (2, 1)),
        ("act", (1,)),
        ("xfrc_applied", (2, 3)),
        ("mocap_pos", (3,)),
    ],
)
def test_wrong_state_shapes(field, shape, bundled):
    model = load(bundled("pendulum"))
    state = make_state(model).replace(**{field: jnp.zeros(shape)})
    for function in (jaxsim.step, jaxsim.forward):
        with pytest.raises(ValueError, match=rf"state\.{field} must have shape"):
            jax.eval_shape(function, model, state)


def test_wrong_control_shapes(bundled):
    model = load(bundled("pendulum"))
    state = make_state(model)
    batch = jax.tree.map(lambda x: x[None], state)
    with pytest.raises(ValueError, match="ctrl must have shape"):
        jax.eval_shape(jaxsim.step, model, state, jnp.zeros(model.nu + 1))
    with pytest.raises(ValueError, match="ctrls must have shape"):
        jax.eval_shape(jaxsim.rollout, model, state, jnp.zeros(model.nu))
    with pytest.raises(ValueError, match="ctrls must have shape"):
        jaxsim.batch_rollout(model, batch, jnp.zeros((1, model.nu)))
    with pytest.raises(ValueError, match="states.qpos must have shape"):
        jaxsim.batch_rollout(model, state, jnp.zeros((1, 2, model.nu)))
    with pytest.raises(ValueError, match="states.qpos must have shape"):
        jaxsim.batch_rollout(model, batch, jnp.zeros((2, 2, model.nu)))


# Fewer than devices; more than one chunk of lanes for each device, and divisible by nothing.
@pytest.mark.parametrize("batch", [1, 1035])
def test_batch_rollout_is_a_batch_of_rollouts(batch, x64):
    model = load(LIMITED)
    rng = np.random.default_rng(0)
    qpos = jnp.asarray(rng.uniform(-1, 1, (batch, model.nq)))
    states = jax.vmap(lambda q: make_state(model).replace(qpos=q))(qpos)
    ctrls = jnp.asarray(rng.uniform(-1, 1, (batch, 7, model.nu)))
    final, seen = jaxsim.batch_rollout(model, states, ctrls, observe=_observe)
    expected, path = quick_jit(jax.vmap(jaxsim.rollout, (None, 0, 0)))(model, states, ctrls)
    jax.tree.map(lambda a, b: np.testing.assert_allclose(a, b, atol=1e-9), final, expected)
    assert seen["angle"].shape == (batch, 7)
    np.testing.assert_allclose(seen["angle"], path.qpos[..., 0], atol=1e-9)
    np.testing.assert_allclose(seen["time"], path.time)


def test_batch_rollout_without_observing():
    model = load("pendulum")
    states = jax.vmap(lambda q: make_state(model).replace(qpos=q[None]))(jnp.linspace(-1, 1, 5))
    final = jaxsim.batch_rollout(model, states, jnp.zeros((5, 3, model.nu)))
    assert final.qpos.shape == (5, 1)
    np.testing.assert_allclose(final.time, 3 * model.opt.timestep, rtol=1e-6)


@pytest.mark.parametrize("name", DEFAULT_BUNDLED)
def test_bundled_models_stay_finite(name):
    _simulate(name, 300, 32)


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_models())
def test_bundled_models_stay_finite_for_long(name):
    _simulate(name, 10_000, 8)


LIMITED = """
<mujoco><option timestep="0.01"/><worldbody><body>
<joint name="a" axis="0 1 0" limited="true" range="-30 30" frictionloss=".01"/>
<geom type="capsule" fromto="0 0 0 0 0 -.5" size=".05"/></body></worldbody>
<actuator><motor joint="a"/></actuator></mujoco>
"""


def _observe(state):
    return {"angle": state.qpos[0], "time": state.time}


def _simulate(name: str, steps: int, batch: int) -> None:
    """Random controls within their ranges, in float32; nothing may become NaN."""
    model = load(name)
    low, high = (model.actuator_ctrlrange[:, i] for i in (0, 1))

    def run(key):
        def body(carry, _):
            state, key, finite = carry
            key, now = jax.random.split(key)
            ctrl = jax.random.uniform(now, (model.nu,), minval=low, maxval=high)
            state = step(model, state, ctrl)
            ok = jnp.isfinite(state.qpos).all() & jnp.isfinite(state.qvel).all()
            return (state, key, finite & ok), None

        start = (make_state(model), key, jnp.array(True))
        (state, _, finite), _ = jax.lax.scan(body, start, length=steps)
        return state, finite

    state, finite = quick_jit(jax.vmap(run))(jax.random.split(jax.random.key(0), batch))
    assert finite.all()
    np.testing.assert_allclose(state.time, steps * model.opt.timestep, rtol=1e-2)


def _mujoco_rollout(mj, data, ctrls) -> np.ndarray:
    copy, found = mujoco.MjData(mj), []
    mujoco.mj_copyData(copy, mj, data)
    for ctrl in ctrls:
        copy.ctrl[:] = ctrl
        mujoco.mj_step(mj, copy)
        found.append(copy.qpos.copy())
    return np.array(found)
