"""What every simulator of contact must do, whatever its equations: friction, rest, impact."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from instants import CONES, converging
from oracle import quick_jit

import jaxsim
from jaxsim.engine.report import forward
from jaxsim.io import load
from jaxsim.model import make_state

G = 9.81
MU = 0.5


@pytest.fixture(autouse=True)
def float64(x64):
    """Laws are exact, or nearly."""


def simulate(model, state, steps: int):
    """Final state and trajectory without controls."""
    return jaxsim.rollout(model, state, jnp.zeros((steps, model.nu)))


BLOCK = f"""
<mujoco><option timestep="0.002" impratio="10"/><worldbody>
  <geom type="plane" size="0 0 1" friction="{MU} .005 .0001"/>
  <body pos="0 0 .1"><freejoint/>
    <geom type="box" size=".2 .2 .1" contype="0" friction="{MU} .005 .0001"/></body>
</worldbody></mujoco>
"""


@pytest.mark.parametrize("cone", list(CONES))
def test_block_on_an_incline(cone):
    """Gravity is tilted instead of the plane: below atan(mu) it sticks, above it slides."""
    model = load(converging(BLOCK, cone))
    tilt = np.arctan(MU) + np.array([-0.2, -0.03, 0.03, 0.2])
    time, steps = 0.5, 250

    def run(angle):
        gravity = G * jnp.stack([jnp.sin(angle), jnp.zeros_like(angle), -jnp.cos(angle)])
        tilted = model.replace(opt=model.opt.replace(gravity=gravity))
        return simulate(tilted, make_state(model), steps)[0]

    final = quick_jit(jax.vmap(run))(jnp.asarray(tilt))
    speed = np.asarray(final.qvel[:, 0])
    sliding = G * (np.sin(tilt) - MU * np.cos(tilt)) * time
    np.testing.assert_allclose(speed[2:], sliding[2:], rtol=0.05, atol=0.02)
    # Soft contacts creep where rigid ones stick.
    assert (np.abs(speed[:2]) < 0.01).all()
    np.testing.assert_allclose(final.qvel[:, 1], 0, atol=1e-6)


def test_sphere_at_rest_on_a_plane():
    """Case G5: where it rests, and how that depends on everything, by the implicit function."""
    xml = """
    <mujoco><option cone="elliptic" timestep="0.002"/><worldbody>
      <geom type="plane" size="0 0 1" solimp=".95 .95 .001"/>
      <body pos="0 0 .1"><freejoint/><geom size=".1" solimp=".95 .95 .001" contype="0"/></body>
    </worldbody></mujoco>"""
    model = load(converging(xml))
    tau, zeta, d = 0.02, 1.0, 0.95
    depth = (1 - d) * G * tau**2 * zeta**2

    def acceleration(x):
        """Of a ball in given depth on surfaces with given numbers."""
        depth, tau, zeta, d, g, mass = x
        solimp = jnp.broadcast_to(jnp.stack([d, d]), (2, 2))
        inertia = model.body_inertia.at[1].multiply(mass / model.body_mass[1])
        changed = model.replace(
            geom_solref=jnp.broadcast_to(jnp.stack([tau, zeta]), (2, 2)),
            geom_solimp=model.geom_solimp.at[:, :2].set(solimp),
            body_mass=model.body_mass.at[1].set(mass),
            body_inertia=inertia,
            body_invweight0=model.body_invweight0.at[1, 0].set(1 / mass),
            opt=model.opt.replace(gravity=jnp.stack([0.0, 0.0, -1.0]) * g),
        )
        qpos = model.qpos0.at[2].set(0.1 - depth)
        qacc = forward(changed, make_state(model).replace(qpos=qpos)).qacc[2]
        return qacc, qacc

    x = jnp.array([depth, tau, zeta, d, G, float(model.body_mass[1])])
    slope, value = quick_jit(jax.jacfwd(acceleration, has_aux=True))(x)
    np.testing.assert_allclose(value, 0, atol=1e-9)
    expected = [0.01962, 3.924e-4, -3.924e-3, 2e-5, 0]
    np.testing.assert_allclose(-slope[1:] / slope[0], expected, rtol=1e-6, atol=1e-12)


def test_stack_of_ten_spheres_stays():
    balls = "".join(
        f'<body pos="0 0 {0.1 + 0.199 * i}"><freejoint/><geom size=".1"/></body>' for i in range(10)
    )
    xml = f"""
    <mujoco><option timestep="0.002"/><worldbody>
      <geom type="plane" size="0 0 1"/>{balls}
    </worldbody></mujoco>"""
    model = load(converging(xml))
    # 55 pairs of balls and floor; only neighbours ever meet.
    final, path = quick_jit(simulate, static_argnums=2)(model, make_state(model), 250)
    height = path.qpos.reshape(250, 10, 7)[:, :, 2]
    assert float(jnp.abs(height - height[:1]).max()) < 0.03
    assert float(jnp.abs(final.qvel).max()) < 0.05
    np.testing.assert_allclose(final.qpos.reshape(10, 7)[:, :2], 0, atol=1e-6)


def test_momentum_in_a_collision_of_free_bodies():
    """Contact forces are internal: linear and angular momentum stay, energy does not grow."""
    xml = """
    <mujoco><option gravity="0 0 0" timestep="0.001"/><worldbody>
      <body><freejoint/><geom size=".1" condim="6" mass="1" friction=".6 .02 .01"/></body>
      <body pos=".3 .08 .03"><freejoint/><geom size=".15" condim="6" mass="3"/></body>
    </worldbody></mujoco>"""
    mj = converging(xml, "elliptic")
    model = load(mj)
    state = make_state(model)
    state = state.replace(qvel=state.qvel.at[:6].set(jnp.array([2.0, 0.3, 0, 3, -5, 8])))
    _, path = quick_jit(simulate, static_argnums=2)(model, state, 200)
    linear, angular, energy = _conserved(mj, path)
    assert np.ptp(path.qvel[:, 6]) > 0.1, "they never met"
    np.testing.assert_allclose(linear, linear[:1].repeat(200, 0), atol=1e-9)
    np.testing.assert_allclose(angular, angular[:1].repeat(200, 0), atol=1e-9)
    assert energy[-1] < energy[0]


def test_four_bar_stays_closed(bundled):
    mj = converging(bundled("four_bar"))
    model = load(mj)
    controls = jnp.full((500, model.nu), 6.0)
    _, path = quick_jit(jaxsim.rollout)(model, make_state(model), controls)
    data, gaps = mujoco.MjData(mj), []
    for qpos in np.asarray(path.qpos):
        data.qpos[:] = qpos
        mujoco.mj_forward(mj, data)
        gaps.append(np.abs(data.efc_pos[:3]).max())
    assert np.abs(np.diff(path.qpos[:, 0])).sum() > 1, "the crank hardly turned"
    assert max(gaps) < 2e-3


def test_energy_never_grows_in_a_passive_scene():
    bodies = "".join(
        f"""<body pos="{x} 0 .3" euler="30 20 {40 * x}"><freejoint/>
        <geom type="{kind}" size="{size}" condim="{dim}" contype="0"
          friction=".6 .02 .01"/></body>"""
        for x, (kind, size, dim) in enumerate(
            [("box", ".1 .15 .05", 3), ("capsule", ".06 .15", 6), ("cylinder", ".1 .05", 4)]
        )
    )
    swing = """<body pos="0 2 1"><joint axis="0 1 0" limited="true" range="-40 40"
        frictionloss=".1"/>
      <geom type="capsule" fromto="0 0 0 .4 0 0" size=".03" contype="0" conaffinity="0"/></body>"""
    mj = converging(
        f"""<mujoco><option timestep="0.001"/><worldbody><geom type="plane" size="0 0 1"/>
        {bodies}{swing}</worldbody></mujoco>""",
        "elliptic",
    )
    model = load(mj)
    state = make_state(model)
    state = state.replace(qvel=jnp.asarray(np.random.default_rng(0).normal(size=model.nv)))
    _, path = quick_jit(simulate, static_argnums=2)(model, state, 700)
    energy = _conserved(mj, path)[2]
    # Soft contacts store energy and give some of it back, but never more than there was.
    assert energy.max() <= energy[0] * (1 + 1e-9)
    assert energy[-1] < 0.7 * energy[0]


def _conserved(mj, path):
    """Linear momentum, angular momentum about the origin, and energy along a trajectory."""
    data, rows = mujoco.MjData(mj), []
    for qpos, qvel in zip(np.asarray(path.qpos), np.asarray(path.qvel), strict=True):
        data.qpos[:], data.qvel[:] = qpos, qvel
        mujoco.mj_forward(mj, data)
        mujoco.mj_subtreeVel(mj, data)
        mujoco.mj_energyPos(mj, data)
        mujoco.mj_energyVel(mj, data)
        mass = mj.body_subtreemass[0]
        linear = mass * data.subtree_linvel[0]
        angular = data.subtree_angmom[0] + np.cross(data.subtree_com[0], linear)
        rows.append((linear, angular, data.energy.sum()))
    return tuple(np.array(x) for x in zip(*rows, strict=True))
