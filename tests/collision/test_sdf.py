"""Signed distance functions: distances as MuJoCo's, rest, motion, derivatives, refusals."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

HALF = np.array([0.3, 0.2, 0.1])
OTHERS = {
    "sphere": 'type="sphere" size=".1"',
    "capsule": 'type="capsule" size=".08 .1"',
    "ellipsoid": 'type="ellipsoid" size=".1 .15 .08"',
    "cylinder": 'type="cylinder" size=".1 .12"',
    "box": 'type="box" size=".1 .12 .09"',
    "mesh": 'type="mesh" mesh="m"',
}
RING = """<mujoco><option timestep=".002"/><worldbody>
  <geom name="floor" type="plane" size="1 1 1"/>
  <body pos="0 0 .1"><freejoint/><geom name="ring" type="cylinder" size=".41 .1" mass="3"/></body>
  <body pos="{}"><freejoint/><geom name="ball" {} mass="1"/></body></worldbody></mujoco>"""


def length(v):
    return jnp.sqrt(v @ v + 1e-30)


def ball(x):
    return length(x) - 0.3


def plank(x):
    out = jnp.abs(x) - HALF
    return length(jnp.maximum(out, 0)) + jnp.minimum(jnp.max(out), 0)


def torus(x, radius):
    return length(jnp.stack([length(x[:2]) - radius["ring"], x[2]])) - radius["tube"]


def ring(pos="0 0 .35", other='size=".25"'):
    functions = {"ring": (torus, {"ring": 0.3, "tube": 0.1})}
    return jaxsim.load(RING.format(pos, other), sdf=functions)


def scene(geom, names):
    bodies = "".join(f"<body><freejoint/><geom {OTHERS[n]} conaffinity='0'/></body>" for n in names)
    return f"""<mujoco><asset><mesh name="m" vertex="-.1 -.1 -.1 .1 -.1 -.1 0 .1 -.1 0 0 .12"/>
      </asset><worldbody><geom name="it" {geom} contype="0"/>{bodies}</worldbody></mujoco>"""


def pushed(mj, data, rng, body, gap):
    """Move a free body to a random pose at this distance from geom 0."""
    at = data.qpos[7 * body : 7 * body + 7]
    at[3:] = rng.normal(size=4)
    at[3:] /= np.linalg.norm(at[3:])
    towards = rng.normal(size=3)
    towards /= np.linalg.norm(towards)
    at[:3] = towards
    ends = np.zeros(6)
    for _ in range(40):
        mujoco.mj_kinematics(mj, data)
        found = mujoco.mj_geomDistance(mj, data, 0, body + 1, 10, ends)
        at[:3] -= 0.5 * towards * (found - gap)
    return found


@pytest.mark.parametrize(
    ("function", "geom", "names", "atol"),
    [
        (ball, 'type="sphere" size=".3"', ("sphere", "mesh"), 1e-8),
        pytest.param(ball, 'type="sphere" size=".3"', tuple(OTHERS), 1e-8, marks=pytest.mark.slow),
        # MuJoCo's own distances are iterations that end.
        pytest.param(
            *(plank, 'type="box" size=".3 .2 .1"', ("sphere", "capsule", "ellipsoid"), 1e-6),
            marks=pytest.mark.slow,
        ),
        # Where edges cross, depths are underestimated.
        pytest.param(
            *(plank, 'type="box" size=".3 .2 .1"', ("cylinder", "box", "mesh"), 3e-3),
            marks=pytest.mark.slow,
        ),
    ],
)
def test_distances_are_mujocos(function, geom, names, atol, rng, x64):
    xml = scene(geom, names)
    model, mj = jaxsim.load(xml, sdf={"it": function}), mujoco.MjModel.from_xml_string(xml)
    mj.opt.ccd_tolerance, mj.opt.ccd_iterations = 1e-10, 200
    data, touched = mujoco.MjData(mj), 0

    @quick_jit
    def nearest(qpos):
        state = jaxsim.make_state(model).replace(qpos=qpos)
        contact = jaxsim.forward(model, state).contact
        geoms = contact.geom1 + contact.geom2  # one of them is 0
        return [jnp.min(jnp.where(geoms == k + 1, contact.dist, 9)) for k in range(len(names))]

    for _ in range(15):
        gaps = [pushed(mj, data, rng, k, rng.uniform(-0.01, 0.01)) for k in range(len(names))]
        found = np.array(nearest(jnp.array(data.qpos)))
        near = np.abs(gaps) < 0.02  # the search above may fail
        touched += near.sum()
        np.testing.assert_allclose(found[near], np.array(gaps)[near], atol=atol)
    assert touched > 10 * len(names)


@pytest.mark.slow
def test_a_ball_rests_in_the_hole_of_a_torus():
    model = ring()
    final, _ = jaxsim.rollout(model, jaxsim.make_state(model), jnp.zeros((500, 0)))
    found = jaxsim.forward(model, final)
    assert np.abs(final.qvel).max() < 1e-3
    # Four contacts each, of the ring with the floor and of the ball with the ring.
    assert int(found.contact.active.sum()) == 8
    np.testing.assert_allclose(found.contact.force[1:5, 0].sum(), 4 * 9.81, rtol=1e-2)
    np.testing.assert_allclose(final.qpos[9] - final.qpos[2], np.sqrt(0.35**2 - 0.3**2), atol=1e-3)


@pytest.mark.slow
def test_a_ball_in_a_bowl_keeps_its_energy_and_its_period(x64):
    """A ball that slides in a sphere of radius 1 is a pendulum of length 0.9."""
    xml = """<mujoco><option timestep=".001" integrator="RK4"/><worldbody>
      <geom name="bowl" type="box" size="1.2 1.2 .6" pos="0 0 .6" condim="1" solref="-1e6 0"/>
      <body pos=".09 0 .29590"><freejoint/><geom size=".1" condim="1" solref="-1e6 0"/></body>
      </worldbody></mujoco>"""

    def bowl(x):  # a ball of radius 1 around (0, 0, 0.6) is cut from a block
        out = jnp.abs(x) - jnp.array([1.2, 1.2, 0.6])
        block = length(jnp.maximum(out, 0)) + jnp.minimum(jnp.max(out), 0)
        return jnp.maximum(block, 1 - length(x - jnp.array([0, 0, 0.6])))

    model = jaxsim.load(xml, sdf={"bowl": bowl})
    state = jaxsim.make_state(model)
    state = state.replace(qpos=state.qpos.at[2].set(1.2 - np.sqrt(0.9**2 - 0.09**2)))
    period = 2 * np.pi * np.sqrt(0.9 / 9.81) * (1 + 0.1**2 / 16)
    final, states = jaxsim.rollout(model, state, jnp.zeros((int(period / 0.001), 0)))
    np.testing.assert_allclose(final.qpos[0], 0.09, atol=2e-3)
    assert np.min(states.qpos[:, 0]) == pytest.approx(-0.09, abs=2e-3)
    assert np.abs(states.qpos[:, 1]).max() < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("other", ["ellipsoid", "sphere", "box"])
def test_derivatives_are_those_of_differences(other, x64):
    """By pose and parameters, in both modes."""
    model = ring(".3 .08 .285", OTHERS[other])
    turned = np.array([0.9, 0.2, 0.3, -0.1])
    qpos = jaxsim.make_state(model).qpos.at[10:].set(turned / np.linalg.norm(turned))
    rng = np.random.default_rng(0)
    along = rng.normal(size=14), dict(zip(("ring", "tube"), rng.normal(size=2), strict=True))

    def touch(t):
        radius = {k: v + t * along[1][k] for k, v in model.sdf["ring"].parameters.items()}
        moved = model.replace(sdf={"ring": model.sdf["ring"].replace(parameters=radius)})
        state = jaxsim.make_state(moved).replace(qpos=qpos + t * along[0])
        contact = jaxsim.forward(moved, state).contact
        k = jnp.argmin(jnp.where(contact.geom1 + contact.geom2 == 3, contact.dist, 9))
        return jnp.concatenate([contact.dist[k][None], contact.pos[k], contact.frame[k, 0]])

    both = quick_jit(lambda t: (touch(t), jax.jacfwd(touch)(t), jax.jacrev(touch)(t)))
    h = 1e-6
    value, forward, reverse = both(0.0)
    assert value[0] < 0
    slope = (both(h)[0] - both(-h)[0]) / (2 * h)
    np.testing.assert_allclose(forward, slope, rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(reverse, forward, atol=1e-10)


@pytest.mark.slow
def test_several_functions_and_batches():
    """Two functions touch each other and a third shape, alone as in a batch, in float32."""
    xml = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
      <body pos="0 0 .099"><freejoint/><geom name="a" type="box" size=".3 .2 .1"/></body>
      <body pos="0 0 .498"><freejoint/><geom name="b" size=".3"/></body></worldbody></mujoco>"""
    model = jaxsim.load(xml, sdf={"a": plank, "b": ball})
    states = jax.vmap(lambda x: jaxsim.make_state(model).replace(qpos=model.qpos0.at[0].add(x)))(
        jnp.linspace(0, 0.1, 3)
    )
    dist = lambda s: jaxsim.forward(model, s).contact.dist  # noqa: E731
    found = jax.jit(jaxsim.vmap(dist))(states)
    np.testing.assert_allclose(found[:, :4], -0.001, atol=1e-6)
    np.testing.assert_allclose(found.min(axis=1), -0.001, atol=1e-6)
    alone = jax.jit(dist)(jax.tree.map(lambda x: x[1], states))
    np.testing.assert_allclose(alone, found[1], atol=1e-6)


def test_what_is_refused():
    xml = RING.format("0 0 .35", 'size=".25"')
    for sdf, error in (
        ({"rings": ball}, "no geom 'rings'"),
        ({"floor": ball}, "geom 'floor' must have a box"),
        ({"ball": lambda x: ball(x)}, "'ball' reaches beyond the box around the geom"),
        ({"ring": lambda x: x}, "must return one number"),
        ({"ring": lambda x: ball(x) * jnp.nan}, "is not finite"),
    ):
        with pytest.raises(ValueError, match=error):
            jaxsim.load(xml, sdf=sdf)
    with pytest.raises(TypeError, match="geom 'ring' needs a function"):
        jaxsim.load(xml, sdf={"ring": 3})
    mj = mujoco.MjModel.from_xml_string(xml)
    mj.geom_type[mj.geom("ring").id] = mujoco.mjtGeom.mjGEOM_SDF
    with pytest.raises(jaxsim.ModelError, match="geom 'ring': type 'sdf' collides only by a func"):
        jaxsim.load(mj)
    model = ring()
    with pytest.raises(jaxsim.ModelError, match="no distance can be measured"):
        jaxsim.geom_distance(model, jaxsim.make_state(model), "ring", "ball")
    assert (jaxsim.to_mujoco(model).geom_size[1] == [0.41, 0.1, 0]).all()
