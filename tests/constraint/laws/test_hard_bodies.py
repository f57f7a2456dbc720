"""Hard contact of rigid bodies: rolling, grasping, coming to rest, motion without contact."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

G = 9.81


@pytest.fixture(autouse=True)
def float64(x64):
    """Laws are exact, or nearly."""


def rollout(model, state, steps, ctrl=()):
    """Final state, trajectory and status under constant controls."""
    ctrls = jnp.broadcast_to(jnp.asarray(ctrl, float), (steps, model.nu))
    return quick_jit(lambda s: jaxsim.rollout(model, s, ctrls, status=True))(state)


BALL = """<mujoco><worldbody><geom type="plane" size="0 0 1" friction=".5"/>
  <body pos="0 0 .05"><freejoint/><geom size=".05" friction=".5"/></body></worldbody></mujoco>"""


def test_a_ball_rolls_and_slips_as_it_should():
    """Down a slope it gains 5/7 g sin(angle); thrown flat, it slips down to 5/7 of its speed."""
    model = jaxsim.load(BALL, contact="hard")

    @quick_jit
    def final(h, gravity, speed, steps):
        changed = model.replace(opt=model.opt.replace(timestep=h, gravity=gravity))
        start = jaxsim.make_state(model)
        start = start.replace(qvel=start.qvel.at[0].set(speed))
        step = lambda _, state: jaxsim.step(changed, state)  # noqa: E731
        return jax.lax.fori_loop(0, steps, step, start)

    angle = np.radians(15)
    tilted = jnp.array([G * np.sin(angle), 0, -G * np.cos(angle)])
    rolled = final(jnp.asarray(0.01), tilted, jnp.zeros(()), 100)
    np.testing.assert_allclose(rolled.qvel[0], 5 / 7 * G * np.sin(angle), atol=1e-6)
    np.testing.assert_allclose(rolled.qvel[4], rolled.qvel[0] / 0.05, rtol=1e-8)
    level, speed = jnp.array([0, 0, -G]), 2.0
    slips = 2 * speed / (7 * 0.5 * G)
    x = speed * slips - 0.25 * G * slips**2 + 5 / 7 * speed * (0.4 - slips)
    for h in (0.02, 0.01, 0.005):
        thrown = final(jnp.asarray(h), level, jnp.asarray(speed), round(0.4 / h))
        np.testing.assert_allclose(thrown.qvel[0], 5 / 7 * speed, atol=1e-9)
        # Second order: only the step in which slipping ends is not exact.
        np.testing.assert_allclose(thrown.qpos[0], x, atol=0.5 * G * h * h / 2)


PENDULUM = """<mujoco><option timestep=".01"/><worldbody><body>
  <joint axis="0 1 0"/><geom type="capsule" fromto="0 0 0 0 0 -1" size=".05"/></body></worldbody>
  </mujoco>"""


@pytest.mark.slow
def test_without_contact_the_energy_of_a_pendulum_does_not_drift():
    """And its error after a swing is of second order in the time step."""
    model = jaxsim.load(PENDULUM, contact="hard")
    start = jaxsim.make_state(model).replace(qpos=jnp.array([2.0]))

    @quick_jit
    def run(h):
        changed = model.replace(opt=model.opt.replace(timestep=h))
        step = lambda state, _: (jaxsim.step(changed, state), state)  # noqa: E731
        return jax.lax.scan(step, start, None, length=800)[1]

    coarse, fine = run(jnp.asarray(0.01)), run(jnp.asarray(0.005))
    finest = run(jnp.asarray(0.0025))
    errors = [
        np.abs(s.qpos[n] - finest.qpos[4 * 150]).max() for s, n in ((coarse, 150), (fine, 300))
    ]
    # The reference errs by a sixteenth of the first: (1 - 1/16) / (1/4 - 1/16) = 5.
    np.testing.assert_allclose(errors[0] / errors[1], 5, rtol=0.1)
    inertia = float(jaxsim.mass_matrix(model, start.qpos)[0, 0])
    weight = float(model.body_mass[1]) * G * 0.5
    energy = 0.5 * inertia * coarse.qvel[:, 0] ** 2 - weight * np.cos(coarse.qpos[:, 0])
    swing = np.ptp(energy[:200])
    assert np.ptp(energy) < 1.05 * swing


SPRUNG = """<mujoco><option timestep=".02"/><worldbody>
  <geom type="plane" size="0 0 1" friction=".2"/>
  <body pos="0 0 .1"><joint type="slide" axis="1 0 0" stiffness="8"/>
    <joint type="slide" axis="0 0 1"/><geom size=".1" mass="2" friction=".2"/></body></worldbody>
  </mujoco>"""


def test_sliding_between_events_is_of_second_order():
    """On a spring: `x = (x0 + a) cos w t + v0 / w sin w t - a`, with `a = mu m g / k`.

    A ball that slips is exact at any step, so it has no slope.
    """
    model, speed, end, w = jaxsim.load(SPRUNG, contact="hard"), 2.0, 0.4, 2.0
    start = jaxsim.make_state(model).replace(qvel=jnp.array([speed, 0.0]))

    @quick_jit
    def final(h, steps):
        changed = model.replace(opt=model.opt.replace(timestep=h))
        step = lambda _, state: jaxsim.step(changed, state)  # noqa: E731
        after = jax.lax.fori_loop(0, steps, step, start)
        return jnp.stack([after.qpos[0], after.qvel[0]])

    a = 0.2 * G / w**2
    x = a * np.cos(w * end) + speed / w * np.sin(w * end) - a
    v = -a * w * np.sin(w * end) + speed * np.cos(w * end)
    assert v > 0.1, "it turns"
    errors = [np.abs(final(jnp.asarray(end / n), n) - np.array([x, v])) for n in (20, 40)]
    slopes = np.log2(errors[0] / errors[1])
    np.testing.assert_allclose(slopes, 2, atol=0.1)


BOX = """<mujoco><option timestep="{}"/><worldbody>
  <geom type="plane" size="0 0 1" friction=".5" margin=".5"/>
  <body pos="0 0 1"><freejoint/><geom type="box" size=".25 .25 .25" friction=".5" contype="0"/>
  </body></worldbody></mujoco>"""


@pytest.mark.slow
@pytest.mark.parametrize("h", [0.1, 0.05, 0.01, 0.005])
def test_a_box_that_is_thrown_comes_to_rest_on_the_ground(h):
    model = jaxsim.load(BOX.format(h), contact="hard")
    state = jaxsim.make_state(model)
    turn = np.array([1, 0.2, 0.3, 0.1])
    state = state.replace(
        qpos=state.qpos.at[3:].set(turn / np.linalg.norm(turn)),
        qvel=jnp.array([2.0, 1, 0, 1, 2, 3]),
    )
    final, path, _ = rollout(model, state, round(3 / h) + 200)
    np.testing.assert_allclose(final.qvel, 0, atol=1e-8)
    np.testing.assert_allclose(final.qpos[2], 0.25, atol=1e-3)
    assert path.qpos[:, 2].max() < 1.01


PAD = """<body pos="{0} 0 0"><joint name="{1}" type="slide" axis="{2} 0 0"/>
  <geom type="box" size=".01 .02 .02" mass=".1" conaffinity="0"/></body>"""
GRASP = f"""<mujoco><option timestep=".002"/><default><geom margin=".002" friction=".7"/></default>
  <worldbody>{PAD.format(-0.03, "left", 1)}{PAD.format(0.03, "right", -1)}<body><freejoint/>
    <geom type="capsule" size=".02 .02" mass=".045" contype="0"/></body></worldbody>
  <actuator><motor joint="left"/><motor joint="right"/></actuator></mujoco>"""


@pytest.mark.slow
def test_a_grasp_does_not_creep():
    """A capsule of 45 g between two pads: the soft law loses some micrometres every second."""
    model = jaxsim.load(GRASP, contact="hard")
    _, path, status = rollout(model, jaxsim.make_state(model), 500, 0.045 * G / 0.7)
    # Four contacts carry what two could, so passes end in rounding, not below their tolerance.
    assert status.rigid_residual < 1e-5
    # Less than 0.01 micrometres per second.
    assert np.abs(path.qpos[-1, 4] - path.qpos[249, 4]) / 0.5 < 1e-8
    assert np.abs(path.qvel[-1]).max() < 1e-8


BODIES = """<mujoco><option timestep=".01"><flag contact="{}"/></option>
  <default><geom friction=".6" margin=".02"/></default><worldbody>
  <geom type="plane" size="0 0 1"/>
  <body pos="0 0 .1"><freejoint/><geom size=".1" mass=".2"/></body>
  <body pos=".2 0 .1"><freejoint/><geom type="box" size=".1 .08 .12" mass="1"/></body>
  <body pos="0 .2 .1"><freejoint/><geom type="capsule" size=".06 .1" mass="3"/></body>
  </worldbody></mujoco>"""


@pytest.mark.slow
def test_contact_never_creates_kinetic_energy(rng):
    """Bodies that are thrown together, some into each other: no more than in a step without it."""
    models = [jaxsim.load(BODIES.format(flag), contact="hard") for flag in ("enable", "disable")]
    start, count = jaxsim.make_state(models[0]), 300
    qpos = np.tile(start.qpos, (count, 1)).reshape(count, 3, 7)
    qpos[:, :, :3] += rng.normal(0, 0.02, (count, 3, 3))
    qpos[:, :, 3:] = rng.normal(size=(count, 3, 4))
    qpos[:, :, 3:] /= np.linalg.norm(qpos[:, :, 3:], axis=2, keepdims=True)
    qvel = rng.normal(size=(count, 18))

    def both(qpos, qvel):
        state = start.replace(qpos=qpos, qvel=qvel)
        (after, status), (free, _) = (jaxsim.step_with_status(model, state) for model in models)
        return after.qvel, free.qvel, status.converged

    after, free, converged = quick_jit(jax.vmap(both))(qpos.reshape(count, -1), qvel)
    inertia = np.concatenate(
        [np.repeat(models[0].body_mass[1:, None], 3, 1), models[0].body_inertia[1:]], axis=1
    ).ravel()
    energy, without = (0.5 * np.sum(inertia * np.asarray(v) ** 2, axis=1) for v in (after, free))
    assert converged.mean() > 0.95
    assert (energy < 0.99 * without).mean() > 0.5, "they do not meet"
    assert (energy <= without * (1 + 1e-10))[converged].all()
