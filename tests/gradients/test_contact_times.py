"""Derivatives through impacts whose answers are known, with `entry_time` and without.

In free flight without gravity, and before an impact, motions are known; only the contact is
simulated. All balls here are springs and dampers on impact, stiff where the answer is for rigid
ones: an impact then lasts pi / omega, which is the error that is allowed for.
"""

import functools
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from oracle import quick_jit

from jaxsim import ModelError, load, make_state, step, substeps, vmap
from jaxsim.gradients import Backward

G = 9.81
RADIUS = 0.1
BALL = """
<mujoco>
  <option tolerance="0"/>
  <default><geom condim="1" solimp=".95 .95 .001"/></default>
  <worldbody>
    <geom type="plane" size="0 0 1"/>
    <body><joint type="slide" axis="0 0 1"/><geom size=".1" contype="0"/></body>
  </worldbody>
</mujoco>
"""
BALLS = """
<mujoco>
  <option timestep="5e-6" gravity="0 0 0" tolerance="0"/>
  <default><geom condim="1" solimp=".95 .95 .001" solref="-3e7 0" mass="1" size=".2"/></default>
  <worldbody>
    <body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><geom/></body>
    <body><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/><geom/></body>
  </worldbody>
</mujoco>
"""


@pytest.fixture(autouse=True)
def float64(x64):
    """Means over phases need digits."""


def final(model, start, steps):
    """Positions and velocities after some steps, as one vector."""
    nv = model.nv
    state = make_state(model).replace(qpos=start[:nv], qvel=start[nv:])
    after = lax.fori_loop(0, steps, lambda _, state: step(model, state), state)
    return jnp.concatenate([after.qpos, after.qvel])


@functools.cache
def ball_program(entry_time: bool):
    """From a table of starts, solref, gravity, timestep and steps to finals and Jacobians."""
    model = load(BALL, backward=Backward(entry_time=entry_time))

    def one(start, solref, gravity, timestep, steps):
        opt = model.opt.replace(timestep=timestep, gravity=jnp.array([0, 0, -gravity]))
        here = model.replace(opt=opt, geom_solref=jnp.tile(solref, (2, 1)))
        f = lambda x: (final(here, x, steps),) * 2  # noqa: E731
        return jax.jacfwd(f, has_aux=True)(start)

    return quick_jit(jax.vmap(one, (0, None, None, None, None)))


def bounce(entry_time, start, solref, gravity, dt, steps, travel):
    """Finals and Jacobians of starts whose heights are spread over `travel`."""
    z = start[0] + (np.arange(48) + 0.5) / 48 * travel
    starts = np.stack([z, np.full(48, start[1])], axis=1)
    values = ball_program(entry_time)(starts, np.array(solref), gravity, dt, steps)
    jacobian, value = (np.asarray(v) for v in values)
    assert np.isfinite(jacobian).all()
    return value, jacobian


@pytest.mark.parametrize(
    ("solref", "truth", "error", "spread"),
    [((0.1, 0.1), 0.637, 0.05, 0.05), ((0.02, 0.1), 0.737, 0.9, 2.5)],
)
def test_soft_bounce(solref, truth, error, spread):
    """Cases G3b and G3 at 1 ms: the force jumps at touchdown by its damping.

    The truth is that of the continuous motion, averaged over the same heights. For G3 a step is
    half of the time constant of the spring, so only the mean tells something.
    """
    inputs = (1.0, 0.0), solref, G, 1e-3, 800, 2 * 4.2021e-3
    value, plain = bounce(False, *inputs)
    same, jacobian = bounce(True, *inputs)
    np.testing.assert_allclose(value, same, rtol=1e-12)
    slopes = jacobian[:, 0, 0]
    assert plain[:, 0, 0].mean() < -4  # wrong in sign and size
    assert slopes.mean() == pytest.approx(truth, rel=error)
    assert slopes.std() < spread


def test_rigid_bounces(benchmark_module):
    """Cases G1 and G2 by stiff springs, of 1e6 / s^2 at steps of 0.1 ms: to 2 per cent."""
    omega = 1e3
    value, jacobian = bounce(True, (1.0, -2.0), (-(omega**2), 0.0), 0.0, 1e-4, 10000, 4e-4)
    z, slope = value[:, 0].mean(), jacobian[:, 0].mean(axis=0)
    assert z == pytest.approx(1.2, rel=0.02)
    np.testing.assert_allclose(slope, [-1, -1], rtol=0.02)
    damping = benchmark_module("gradient_truths").damping_of(0.8)
    solref = -(omega**2), -2 * damping * omega
    value, jacobian = bounce(True, (1.0, 0.0), solref, G, 1e-4, 8000, 8.4e-4)
    z, slope = value[:, 0].mean(), jacobian[:, 0].mean(axis=0)
    assert z == pytest.approx(0.671884927515, rel=0.02)
    np.testing.assert_allclose(slope[0], 0.761713848619, rtol=0.02)
    # It is the difference of two numbers of this size.
    np.testing.assert_allclose(slope[1], 0.0289647136194, atol=0.02 * 0.8)


def test_billiards():
    """Cases G10 and G11: head on, and off axis, where the normal moves; 1e-3 and 5e-3."""
    model = load(BALLS, backward=Backward(entry_time=True))

    def end(start, before, after, steps):
        """Free flights are exact; `before` and `after` are their times."""
        h, nv = model.opt.timestep, model.nv
        met = final(model, start.at[:nv].add(before * start[nv:]), steps)
        return met[:nv] + (after - h * steps) * met[nv:]

    def both(*inputs):
        return end(*inputs), jax.jacfwd(end)(*inputs)

    run = quick_jit(jax.vmap(both, (0, None, None, None)))
    phases = (np.arange(16) + 0.5) / 16 * 1e-5
    head_on = np.array([0, 0, 0.72, 0, 1, 0, 0, 0.0])
    aside = np.array([0, 0, 1, 0.15, 2, 0, 0, 0.0])
    starts = np.stack([x + p * np.eye(8)[0] for x in (head_on, aside) for p in phases])
    first = [np.asarray(a).mean(axis=0) for a in run(starts[:16], 0.3199, 0.6801, 300)]
    np.testing.assert_allclose(first[0][2], 1.4, rtol=1e-3)
    np.testing.assert_allclose(first[1][2, [0, 2, 4, 6]], [1, 0, 1, 0], atol=1e-2)
    t = (1 - 0.4 * math.sqrt(1 - 0.375**2)) / 2 - 1e-4
    value, slope = (np.asarray(a).mean(axis=0) for a in run(starts[16:], t, 1 - t, 300))
    np.testing.assert_allclose(value[2:], [2.17803977874, 0.626540554083], rtol=0.02)
    np.testing.assert_allclose(slope[2:, 3], [-2.91790291225, 3.51644960458], rtol=0.02)
    np.testing.assert_allclose(slope[2:, 4], [0.859375, 0.347634304083], rtol=0.02)


def test_options_that_do_not_combine():
    with pytest.raises(ValueError, match="does not combine"):
        Backward(entry_time=True, distance=0.01)
    with pytest.raises(ValueError, match="at least 1"):
        Backward(softening=0.5)
    with pytest.raises(ModelError, match="needs contact='mujoco'"):
        load(BALL, contact="sap", backward=Backward(distance=0.01))
    with pytest.raises(ModelError, match="RK4"):
        load(
            BALL.replace("<option", '<option integrator="RK4"'), backward=Backward(entry_time=True)
        )


def test_contact_from_a_distance_and_softer():
    """A ball above the floor, and one at rest: values as before, other derivatives."""
    starts = np.array([[RADIUS + 5e-3, -0.1], [RADIUS - 1e-4, 0.0]])

    def all_of(backward):
        model = load(BALL, backward=backward)
        f = lambda x: (final(model, x, 1),) * 2  # noqa: E731
        return quick_jit(jax.vmap(jax.jacfwd(f, has_aux=True)))(starts)

    exact, value = all_of(None)
    early, same = all_of(Backward(distance=0.01))
    soft, too = all_of(Backward(softening=3.0))
    np.testing.assert_array_equal(value, same)
    np.testing.assert_array_equal(value, too)
    assert exact[0, 1, 0] == 0
    assert early[0, 1, 0] < -1  # nearer to the floor is faster away from it
    stiffness = 0.95 / (0.95 * 0.02) ** 2 * 0.95  # d^2 k
    np.testing.assert_allclose(exact[1, 1, 0], -2e-3 * stiffness, rtol=1e-6)
    np.testing.assert_allclose(soft[1, 1, 0], exact[1, 1, 0] / 9, rtol=1e-6)
    np.testing.assert_array_equal(soft[0], exact[0])


def test_both_modes():
    """In the first step of a contact, the last, and neither; the batch last."""
    model = load(BALL, backward=Backward(entry_time=True))
    starts = np.array([[RADIUS - 1e-3, -1.0], [RADIUS - 1e-4, 0.1], [RADIUS - 1e-4, 0.0], [1, 0]])

    def both(x):
        f = lambda x: final(model, x, 1)  # noqa: E731
        return jax.jacfwd(f)(x), jax.jacrev(f)(x)

    forward, reverse = quick_jit(vmap(both))(starts)
    np.testing.assert_allclose(forward, reverse, rtol=1e-10)
    h, (k, b) = 2e-3, (0.95 / 0.019**2 * 0.95, 2 / 0.02)  # of d a_ref
    # In the first step s is 1/2, so that it gets the jump times dt = dz / v - r dv / v^2 only.
    jump = b * 1.0 + 0.95 * G
    expected = [-h * k - jump, 1 - h * b + 1e-3 * jump]
    np.testing.assert_allclose(forward[0, 1], expected, rtol=1e-6)


def test_substeps():
    """Sub-steps of a fall are shorter steps, and a phase moves them without changing the time."""
    model = load(BALL)
    state = make_state(model).replace(qpos=jnp.array([1.0]))
    h = float(model.opt.timestep)
    run = quick_jit(
        lambda phase: [
            substeps(model, state, count=4),
            substeps(model, state, count=4, phase=phase),
        ]
    )
    for after, shares in zip(run(0.25), ([1, 1, 1, 1], [0.25, 1, 1, 1, 0.75]), strict=True):
        v, z = 0.0, 1.0
        for share in shares:
            v -= G * share * h / 4
            z += v * share * h / 4
        np.testing.assert_allclose(
            [after.qpos[0], after.qvel[0], after.time], [z, v, h], rtol=1e-12
        )
    with pytest.raises(ValueError, match="count"):
        substeps(model, state, count=0)
