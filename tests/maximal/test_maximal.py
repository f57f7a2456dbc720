"""Free bodies with joints as rows move as the tree does."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.collision import find_candidates
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.maximal.free_bodies import free_bodies

# Every kind of joint, on one body or on several, with all that acts in joint coordinates; the last
# body is welded to its parent.
JOINTS = """<mujoco><option timestep=".001"/><worldbody>
  <geom type="plane" size="0 0 1"/>
  <body pos="0 0 .8"><joint type="slide" axis="1 0 0" range="-.2 .2" limited="true"/>
    <joint type="slide" axis="0 0 1"/>
    <joint name="turn" axis="0 1 0" damping=".1" armature=".03" stiffness="2" frictionloss=".02"/>
    <geom type="capsule" size=".03 .2" pos="0 0 -.2"/>
    <body pos="0 0 -.4"><joint type="ball" damping=".1" range="0 40" limited="true"/>
      <geom type="capsule" size=".03 .1" pos="0 .05 -.1"/>
      <body pos="0 0 -.25"><geom size=".05"/>
        <body pos=".1 0 0"><joint name="push" type="slide" axis="1 0 1" stiffness="50"/>
          <geom size=".05"/></body></body></body></body>
  <body pos=".5 0 .049"><freejoint/><geom size=".05"/></body></worldbody>
  <actuator><position joint="turn" kp="3"/><motor joint="push"/></actuator></mujoco>"""
PENDULUM = """<mujoco><worldbody><body><joint axis="0 1 0" pos=".02 0 .1"/>
  <geom type="capsule" size=".03 .2" pos="0 0 -.2"/></body></worldbody></mujoco>"""


def somewhere(model, rng, speed: float = 1.0) -> jaxsim.State:
    """A random state near the reference configuration."""
    start = jaxsim.make_state(model)
    step, qvel = (
        jnp.asarray(0.3 * rng.normal(size=model.nv)),
        jnp.asarray(rng.normal(size=model.nv)),
    )
    return start.replace(qpos=integrate_pos(model, start.qpos, step, 1.0), qvel=speed * qvel)


def euler(mj: mujoco.MjModel) -> mujoco.MjModel:
    """The model with semi-implicit Euler, and with solves that end at rounding."""
    mj.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    mj.opt.iterations, mj.opt.ls_iterations, mj.opt.tolerance = 100, 50, 0
    return mj


def agree(model, rng, tolerance: float, speed: float = 1.0) -> None:
    """Accelerations in both coordinates, and states converted there and back."""
    maximal = jaxsim.to_maximal(model)
    ctrl = jnp.asarray(rng.uniform(-1, 1, model.nu))

    @quick_jit
    def both(state):
        free = maximal.state(state)
        found, status = maximal.acceleration(free, ctrl)
        return found, status, maximal.tree_state(free), jaxsim.forward(model, state, ctrl).qacc

    for _ in range(3):
        state = somewhere(model, rng, speed)
        found, status, back, truth = both(state)
        assert status.converged
        np.testing.assert_allclose(found, truth, rtol=0, atol=tolerance * np.abs(truth).max())
        np.testing.assert_allclose(back.qvel, state.qvel, atol=1e-12)
        np.testing.assert_allclose(back.qpos, state.qpos, atol=1e-12)


def test_a_pendulum(x64, rng):
    """The shortest chain: one body and six rows of rank five."""
    agree(jaxsim.load(PENDULUM), rng, 1e-10)


@pytest.mark.slow
def test_all_joints_and_what_acts_on_them(x64, rng):
    """To ten times the tolerance of the passes, 5e-11 of the largest force."""
    agree(jaxsim.load(JOINTS), rng, 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "speed"), [("double_pendulum", 1), ("arm", 1), ("four_bar", 1), ("quadruped", 0)]
)
def test_bundled_models(name, speed, x64, rng, bundled):
    """Serial chains, a loop, and legs on the ground.

    Rows of contacts leave out the rates of their Jacobians, which differ: they agree at rest.
    """
    agree(jaxsim.load(euler(bundled(name))), rng, 1e-9, speed)


@pytest.mark.slow
@pytest.mark.parametrize("hessian", ["dense", "iterative"])
def test_steps_keep_the_joints_together(hessian, x64, bundled):
    """Motions differ by what a step leaves of the joints' errors, of second order in the step."""
    model = jaxsim.load(euler(bundled("double_pendulum")), hessian=hessian)

    def errors(h):
        tree = model.replace(opt=model.opt.replace(timestep=jnp.asarray(h)))
        maximal = jaxsim.to_maximal(tree)

        @quick_jit
        def run(state):
            def advance(free, _):
                free, status = maximal.step_with_status(free)
                return free, (maximal.joint_error(free), status.converged)

            free, (error, converged) = jax.lax.scan(
                advance, maximal.state(state), length=round(0.4 / h)
            )
            final, _ = jaxsim.rollout(tree, state, jnp.zeros((round(0.4 / h), tree.nu)))
            apart = jnp.abs(maximal.tree_state(free).qpos - final.qpos).max()
            return error.max(), apart, converged.all()

        start = jaxsim.make_state(model)
        return run(start.replace(qpos=start.qpos + 1.0, qvel=start.qvel + 1.0))

    coarse, fine = errors(0.004), errors(0.002)
    assert coarse[2]
    assert fine[2]
    assert fine[0] < 4e-5
    assert coarse[0] / fine[0] > 3.5
    assert fine[1] < 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivatives_are_those_of_the_tree(mode, x64, bundled):
    """Of the acceleration, with respect to position and velocity of the tree."""
    model = jaxsim.load(euler(bundled("double_pendulum")))
    maximal = jaxsim.to_maximal(model)
    start = jaxsim.make_state(model)
    x = jnp.asarray([0.4, -0.7, 0.3, 1.1])

    def state(x):
        return start.replace(qpos=x[:2], qvel=x[2:])

    found = quick_jit(mode(lambda x: maximal.acceleration(maximal.state(state(x)))[0]))(x)
    truth = quick_jit(mode(lambda x: jaxsim.forward(model, state(x)).qacc))(x)
    np.testing.assert_allclose(found, truth, atol=1e-8 * np.abs(truth).max())


@pytest.mark.slow
def test_a_batch_on_the_ground():
    """A pendulum that meets the ground, in float32, mapped over its start."""
    xml = PENDULUM.replace(
        "<worldbody>", '<worldbody><geom type="plane" size="0 0 1" pos="0 0 -.2"/>'
    )
    model = jaxsim.load(xml, contact="sap")
    maximal, start = jaxsim.to_maximal(model), jaxsim.make_state(model)

    def run(angle):
        state = start.replace(qpos=angle[None])
        advance = lambda free, _: maximal.step_with_status(free)  # noqa: E731
        free, status = jax.lax.scan(advance, maximal.state(state), length=200)
        final, _ = jaxsim.rollout(model, state, jnp.zeros((200, 0)))
        return maximal.tree_state(free).qpos, final.qpos, status.converged.all()

    found, truth, converged = quick_jit(jaxsim.vmap(run))(jnp.asarray([1.0, 1.3]))
    assert converged.all()
    np.testing.assert_allclose(found, truth, atol=5e-3)


@pytest.mark.slow
def test_passes_converge_where_joints_and_contacts_hold_a_body(x64):
    """A pendulum comes to rest on the ground under hard contact, its joint in place."""
    xml = PENDULUM.replace(
        "<worldbody>", '<worldbody><geom type="plane" size="0 0 1" pos="0 0 -.25"/>'
    )
    model = jaxsim.load(xml, contact="hard")
    maximal, start = jaxsim.to_maximal(model), jaxsim.make_state(model)

    @quick_jit
    def run(free):
        advance = lambda free, _: maximal.step_with_status(free)  # noqa: E731
        free, status = jax.lax.scan(advance, free, length=300)
        return maximal.joint_error(free), maximal.tree_state(free).qvel, status.converged

    error, speed, converged = run(maximal.state(start.replace(qpos=start.qpos + 1.0)))
    assert converged.all()
    np.testing.assert_allclose(error, 0, atol=1e-6)
    np.testing.assert_allclose(speed, 0, atol=1e-6)


def test_the_same_geoms_may_touch(rng):
    """Without a body and its parent, with explicit pairs and meshes, at the same places."""
    points = rng.normal(size=(12, 3))
    mj = mujoco.MjModel.from_xml_string(f"""<mujoco><asset>
      <mesh name="m" vertex="{" ".join(map(str, points.ravel()))}"/></asset><worldbody>
      <geom type="plane" size="0 0 1"/>
      <body name="a"><joint/><geom type="mesh" mesh="m" pos=".1 .2 .3" euler="10 20 30"/>
        <geom name="g" size=".1" contype="0" conaffinity="0"/>
        <body name="b"><joint/><geom size=".1"/><body name="c"><joint/><geom name="h" size=".1"/>
        </body></body></body></worldbody>
      <contact><exclude body1="a" body2="c"/>
        <pair geom1="g" geom2="h" friction="1 1 .1 .2 .3"/></contact></mujoco>""")
    free = free_bodies(mj)
    pairs = [
        sorted((*sorted(p), g.kind) for g in find_candidates(m).groups for p in _pairs(g))
        for m in (mj, free)
    ]
    assert pairs[0] == pairs[1]
    np.testing.assert_allclose(free.pair_friction, mj.pair_friction)
    ends = [mujoco.MjData(m) for m in (mj, free)]
    for m, data in zip((mj, free), ends, strict=True):
        mujoco.mj_kinematics(m, data)
    np.testing.assert_allclose(ends[1].geom_xpos, ends[0].geom_xpos, atol=1e-6)
    np.testing.assert_allclose(free.body_mass, mj.body_mass)


def _pairs(group):
    return zip(group.geom1.tolist(), group.geom2.tolist(), group.pair.tolist(), strict=True)


def test_what_does_not_carry_over_is_told():
    """By name."""
    load = functools.partial(str.format, "<mujoco>{}<worldbody>{}</worldbody></mujoco>")
    joint = '<body name="arm"><joint/><geom size=".1"/>{}</body>'
    scenes = {
        "RK4": load('<option integrator="RK4"/>', joint.format("")),
        "noslip": load('<option noslip_iterations="3"/>', joint.format("")),
        "'tip'": load("", joint.format('<body name="tip"><site name="s"/></body>')),
    }
    for message, xml in scenes.items():
        model = jaxsim.load(xml)
        with pytest.raises(jaxsim.ModelError, match=message):
            jaxsim.to_maximal(model)
    with pytest.raises(TypeError, match="load"):
        jaxsim.to_maximal(mujoco.MjModel.from_xml_string(PENDULUM))
