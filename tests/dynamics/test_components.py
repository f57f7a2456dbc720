"""Motion with fewer than six components: found where it is known, and exact where it is used."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.dynamics.components import ALL, motion_components
from jaxsim.model.facts import Constants

PLANAR = """
<mujoco><option cone="{cone}" timestep=".005"/>
<worldbody>
  <geom type="plane" size="5 5 1" condim="1"/>
  <body pos="0 .1 .3">
    <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1" frictionloss=".3"/>
    <joint axis="0 1 0" damping=".2"/>
    <geom type="capsule" size=".06" fromto="-.2 .03 0 .2 -.02 0" condim="{condim}" contype="{self}"
          conaffinity="1"/>
    <body pos=".2 -.05 0" quat=".8 0 .6 0">
      <joint axis="0 -1 0" limited="true" range="-40 50" armature=".01"/>
      <geom type="capsule" size=".05" fromto="0 0 0 0 .05 -.3" condim="{condim}"/></body>
    <body name="leg" pos="-.2 .02 0">
      <joint axis="0 1 0" stiffness="2" frictionloss=".1"/>
      <geom type="capsule" size=".05" fromto="0 0 0 0 -.05 -.3" condim="{condim}"/>
      <body pos="0 0 -.3">
        <joint name="j" axis="0 1 0"/><geom size=".07" pos=".05 .04 0"/></body></body>
  </body>
</worldbody>
{more}
<actuator><motor joint="j"/></actuator></mujoco>
"""
BODY = '<body pos=".1 .2 .3" {frame}>{joints}<geom size=".1"/>{more}</body>'
SLIDE, HINGE = '<joint type="slide" axis="{}"/>', '<joint axis="{}"/>'


def mjcf(joints="", frame="", more="", world=""):
    body = BODY.format(joints=joints, frame=frame, more=more)
    return f"<mujoco><worldbody>{body}{world}</worldbody></mujoco>"


def child(joints, frame=""):
    return BODY.format(joints=joints, frame=frame, more="")


ON_MOCAP = f"""<mujoco><worldbody>
  <body mocap="true">{child(HINGE.format("0 1 0"))}</body></worldbody></mujoco>"""


def jointed(joint, frame=""):
    return mjcf(HINGE.format("0 1 0"), more=child(joint, frame))


FOUND = {
    "hinge": (mjcf(HINGE.format("0 0 -2")), (2, 3, 4)),
    "slide": (mjcf(SLIDE.format("0 1 0")), (4,)),
    "slides": (mjcf(SLIDE.format("0 1 0") + SLIDE.format("1 1 0")), (3, 4)),
    "screw": (mjcf(HINGE.format("1 0 0") + SLIDE.format("1 0 0")), (0, 3, 4, 5)),
    "half turn": (mjcf(HINGE.format("0 1 0"), 'quat="0 1 0 0"'), (1, 3, 5)),
    "turned": (jointed(HINGE.format("0 1 0"), 'quat=".6 0 .8 0"'), (1, 3, 5)),
    "two trees": (mjcf(HINGE.format("0 1 0"), world=child(SLIDE.format("0 0 1"))), (1, 3, 5)),
    "quarter": (mjcf(HINGE.format("0 1 0"), 'quat="1 1 0 0"'), ALL),
    "tilted": (mjcf(HINGE.format("0 1 .01")), ALL),
    "universal": (mjcf(HINGE.format("0 1 0") + HINGE.format("1 0 0")), ALL),
    "child turned": (jointed(HINGE.format("0 1 0"), 'quat=".6 .8 0 0"'), ALL),
    "ball": (mjcf('<joint type="ball"/>'), ALL),
    "free": (mjcf("<freejoint/>", world=child(HINGE.format("0 1 0"))), ALL),
    "mocap": (ON_MOCAP, ALL),
    "nothing": (mjcf(), ALL),
}


@pytest.mark.parametrize("name", FOUND)
def test_components_are_those_of_the_axes(name):
    xml, expected = FOUND[name]
    assert motion_components(jaxsim.load(xml)) == expected


@pytest.mark.parametrize("name", FOUND)
def test_components_left_out_are_zero_in_motion(name, rng):
    """All links' velocities, at random positions and velocities, from the full recursion."""
    xml, components = FOUND[name]
    model = jaxsim.load(xml)
    kin = jax.jit(jaxsim.dynamics.kinematics.kinematics)(model, rng.standard_normal(model.nq))
    left_out = np.setdiff1d(range(6), components)
    assert not np.asarray(kin.cdof)[:, left_out].any()


def test_directions_are_looked_at_as_they_are_now():
    model = jaxsim.load(FOUND["hinge"][0])
    turned = model.replace(jnt_axis=jnp.array([[0.0, 1.0, 0.0]]))
    assert motion_components(turned) == (1, 3, 5)
    tilted = jnp.array([[1.0, 0, 0, 0], [0.6, 0.8, 0, 0]])
    assert motion_components(model.replace(body_quat=tilted)) == ALL


def test_nothing_is_known_of_what_is_traced():
    model = jaxsim.load(FOUND["hinge"][0])
    seen = []

    def look(axis):
        seen.append(motion_components(model.replace(jnt_axis=axis)))
        return axis.sum()

    jax.jit(look)(model.jnt_axis), jax.grad(look)(model.jnt_axis)
    jax.vmap(look)(model.jnt_axis[None]), jaxsim.vmap(look)(model.jnt_axis[None])
    assert seen == [ALL] * 4


def test_directions_survive_jit():
    model = jaxsim.load(FOUND["turned"][0])
    constants = Constants.of(model, motion_components.leaves)
    seen = []

    def look(model):
        assert motion_components(model) == ALL
        again = constants.put_into(model)
        seen.append(motion_components(again))
        return again

    again = jax.jit(look)(model)
    assert seen == [(1, 3, 5)]
    np.testing.assert_array_equal(again.body_quat, model.body_quat)


def planar(cone="pyramidal", condim=3, self=0, more="", **options):
    return jaxsim.load(planar_mujoco(cone, condim, self, more), **options)


def planar_mujoco(cone="pyramidal", condim=3, self=0, more=""):
    xml = PLANAR.format(cone=cone, condim=condim, self=self, more=more)
    return mujoco.MjModel.from_xml_string(xml)


CONNECT = '<equality><connect body1="leg" body2="world" anchor="0 0 .1"/></equality>'
JOINT = '<equality><joint joint1="j" polycoef=".1 0 0 0 0"/></equality>'
CONES = [(cone, d) for cone in ("pyramidal", "elliptic") for d in (1, 3, 4, 6)]
PROBLEMS = {
    **{f"{cone}{d}": {"cone": cone, "condim": d} for cone, d in CONES},
    "dense": {"hessian": "dense"},
    "iterative": {"hessian": "iterative"},
    "coupled": {"self": 1},
    "coupled, iterative": {"self": 1, "hessian": "iterative"},
    "joints": {"more": JOINT},
    "connected": {"more": CONNECT},
}


def states(model, rng, count=8):
    state = jaxsim.make_state(model)
    low = jnp.array([0, -0.15, 0, 0, 0, 0])  # some are on the floor
    qpos = low[None] + 0.3 * rng.standard_normal((count, model.nq))
    qvel = rng.standard_normal((count, model.nv))
    return jax.vmap(lambda q, v: state.replace(qpos=q, qvel=v))(qpos, qvel)


USUAL = ("pyramidal3",)
MARKED = [p if p in USUAL else pytest.param(p, marks=pytest.mark.slow) for p in PROBLEMS]


@pytest.mark.parametrize("name", MARKED)
def test_planar_steps_are_those_of_the_whole_recursions(name, rng, x64):
    model = planar(**PROBLEMS[name])
    assert motion_components(model) == (1, 3, 5)
    batch, ctrl = states(model, rng), jnp.ones((8, 1))
    known = quick_jit(jax.vmap(lambda s, u: jaxsim.forward(model, s, u)))(batch, ctrl)
    whole = quick_jit(jax.vmap(jaxsim.forward, in_axes=(None, 0, 0)))(model, batch, ctrl)
    assert int(known.contact.active.sum()) > 0
    close = functools.partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-8)
    close(known.qacc, whole.qacc)
    close(known.qacc_smooth, whole.qacc_smooth)
    close(known.qfrc_constraint, whole.qfrc_constraint)
    close(known.contact.force, whole.contact.force)
    if name == "pyramidal3":  # Implicit damping, too.
        after = quick_jit(jax.vmap(lambda s, u: jaxsim.step(model, s, u)))(batch, ctrl)
        reference = quick_jit(jax.vmap(jaxsim.step, in_axes=(None, 0, 0)))(model, batch, ctrl)
        close(after.qvel, reference.qvel)


@pytest.mark.slow
def test_planar_derivatives_are_those_of_the_whole_recursions(rng, x64):
    model = planar(self=1)
    state = jax.tree.map(lambda x: x[0], states(model, rng))

    def after(model, qpos):
        return jaxsim.step(model, state.replace(qpos=qpos), jnp.ones(1)).qvel

    whole = quick_jit(jax.jacfwd(after, argnums=1))(model, state.qpos)
    known = quick_jit(jax.jacrev(lambda qpos: after(model, qpos)))(state.qpos)
    np.testing.assert_allclose(known, whole, rtol=1e-9, atol=1e-9)


@pytest.mark.slow
def test_derivatives_by_axes_that_leave_the_plane(rng, x64):
    """They need the components that are zero, so nothing may be left out."""
    model = planar()
    state = jax.tree.map(lambda x: x[1], states(model, rng))
    direction = jnp.asarray(rng.standard_normal((model.njnt, 3)))

    @quick_jit
    def speed(t):
        axis = model.jnt_axis + t * direction
        return jaxsim.step(model.replace(jnt_axis=axis), state, jnp.ones(1)).qvel

    slope = jax.jacfwd(speed)(0.0)
    h = 1e-6
    np.testing.assert_allclose(slope, (speed(h) - speed(-h)) / (2 * h), rtol=1e-5, atol=1e-6)


def out_of_plane(model):
    """The axes of the joints, with the last one tilted."""
    return model.jnt_axis.at[-1].set(jnp.array([0.6, 0.8, 0.0]))


@pytest.mark.slow
def test_a_planar_model_that_becomes_spatial(rng, x64):
    """With another axis it is what a model loaded with that axis is, however it is passed."""
    model, mj = planar(), planar_mujoco()
    mj.jnt_axis[-1] = [0.6, 0.8, 0.0]
    loaded, axis = jaxsim.load(mj), out_of_plane(model)
    turned = model.replace(jnt_axis=axis)
    assert (motion_components(model), motion_components(turned)) == ((1, 3, 5), ALL)
    state = jax.tree.map(lambda x: x[1], states(model, rng))

    def after(model):
        return jaxsim.step(model, state, jnp.ones(1)).qvel

    def with_axis(axis):
        return after(model.replace(jnt_axis=axis))

    expected = quick_jit(lambda: after(loaded))()
    stay = quick_jit(lambda: after(model))()
    assert np.abs(expected - stay).max() > 1e-3
    close = functools.partial(np.testing.assert_allclose, rtol=1e-9, atol=1e-9)
    close(quick_jit(lambda: after(turned))(), expected)
    close(quick_jit(after)(turned), expected)
    both = jnp.stack([model.jnt_axis, axis])
    for vmap in (jax.vmap, jaxsim.vmap):
        close(quick_jit(vmap(with_axis))(both), [stay, expected])
    gradient = quick_jit(jax.grad(lambda axis: with_axis(axis) @ jnp.arange(6.0)))(model.jnt_axis)
    assert np.abs(gradient[:, [0, 2]]).max() > 1e-3  # of directions out of the plane


def test_rollouts_of_models_with_other_axes(rng):
    """A compiled rollout is not used for a model whose joints turn about other axes."""
    model = jaxsim.load(FOUND["turned"][0])
    state = jaxsim.make_state(model)
    batch = jax.vmap(lambda v: state.replace(qvel=v))(rng.standard_normal((8, 2)))
    ctrls = jnp.zeros((8, 3, 0))
    rollouts = jax.vmap(lambda m, s, u: jaxsim.rollout(m, s, u)[0], in_axes=(None, 0, 0))
    reference = quick_jit(rollouts)  # of a model that is an argument nothing is known
    found = []
    for one in (model, model.replace(jnt_axis=out_of_plane(model))):
        found.append(jaxsim.batch_rollout(one, batch, ctrls).qvel)
        expected = reference(one, batch, ctrls).qvel
        np.testing.assert_allclose(found[-1], expected, rtol=1e-4, atol=1e-5)
    assert np.abs(found[0] - found[1]).max() > 1e-3
