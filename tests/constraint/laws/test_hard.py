"""Hard contact: Coulomb and Signorini to rounding, restitution, stacks, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit
from point_mass import TIMESTEP, compiled_step, point_mass, repeated

import jaxsim

FRICTIONS = (0.1, 0.3, 0.5, 0.7, 1.0)
ANGLES = (3, 10, 20, 30, 40)


def test_slides_sticks_and_bounces_as_the_laws_say():
    """Stopping distances, no creep, sticking on slopes, and Newton's restitution."""
    model = point_mass("hard", materials={"mass": {"restitution": 0.5}})
    step = compiled_step(model)

    def friction(mu, gravity=(0.0, 0.0, -10.0)):
        opt = model.opt.replace(gravity=jnp.asarray(gravity))
        return model.replace(geom_friction=jnp.full_like(model.geom_friction, mu), opt=opt)

    for mu in (0.2, 0.7):
        qpos, qvel, status = repeated(step, 260, [0, 0], [2, 0], model=friction(mu))
        # Within the step in which it stops, the speed is taken to fall evenly.
        np.testing.assert_allclose(
            qpos[-1, 0], 2**2 / (2 * mu * 10), atol=mu * 10 * TIMESTEP**2 / 8
        )
        assert np.abs(qpos[:, 1]).max() < 1e-12
        assert status.converged.all()
        assert status.passes.max() < 20
        assert status.rigid_residual.max() < 1e-9
    for mu in FRICTIONS:
        for angle in (*np.radians(ANGLES), *(np.arctan(mu) + np.radians([-0.1, 0.1]))):
            gravity = 10 * np.sin(angle), 0, -10 * np.cos(angle)
            _, qvel, _ = repeated(step, 2, [0, 0], [0, 0], model=friction(mu, gravity))
            slides = 10 * (np.sin(angle) - mu * np.cos(angle)) * 2 * TIMESTEP
            np.testing.assert_allclose(qvel[-1], [max(slides, 0), 0], atol=1e-12)
    _, qvel, _ = repeated(step, 30, [0, 0], [0, 0], 5.0)
    assert np.abs(qvel).max() < 1e-12
    state, _ = step([0, 0.003], [0.1, -2])
    impact = np.sqrt(2**2 + 2 * 10 * 0.003)
    rest = TIMESTEP - (impact - 2) / 10
    np.testing.assert_allclose(state.qvel[1], 0.5 * impact - 10 * rest, atol=1e-12)


STACK = """<mujoco><option timestep=".002"/><worldbody>
  <geom type="plane" size="0 0 1" contype="0" conaffinity="1"/>{}</worldbody></mujoco>"""
BALL = """<body pos="0 0 {}"><joint type="slide" axis="0 0 1"/><joint type="slide" axis="1 0 0"/>
  <geom size=".1" mass="{}" contype="{}" conaffinity="{}"/></body>"""


@pytest.mark.slow
@pytest.mark.parametrize("masses", [(1.0,) * 10, (1e3, 1e-3) * 5], ids=["equal", "alternating"])
def test_a_stack_of_ten_rests(masses):
    """Velocities vanish, and each contact carries what lies on it.

    Balls and not cubes: four contacts between cubes of such masses do not converge, since rounding
    decides how they share a force. The regularisation of a pass is 2e-4 of the inverse inertia.
    """
    balls = [BALL.format(0.1 + 0.2 * i, m, 2**i, 2 ** (i + 1)) for i, m in enumerate(masses)]
    model = jaxsim.load(STACK.format("".join(balls)), contact="hard")
    state = jaxsim.make_state(model)
    both = quick_jit(
        lambda s: (jaxsim.step_with_status(model, s), jaxsim.forward(model, s).contact)
    )
    (after, status), contact = both(state)
    assert status.converged
    np.testing.assert_allclose(after.qvel, 0, atol=1e-8)
    force = contact.force[:, 0]
    expected = 9.81 * np.cumsum(masses[::-1])
    np.testing.assert_allclose(np.sort(force[force > 0]), np.sort(expected), rtol=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("start", [[2.0, 0.0], [0.0, 0.0]], ids=["slides", "sticks"])
def test_derivatives_are_those_of_the_exact_solution(start):
    """Both modes and finite differences, by speed, height, friction, mass and push."""
    model = point_mass("hard")
    state = jaxsim.make_state(model)

    def final(p):
        friction = model.geom_friction.at[:, 0].set(p[2])
        changed = model.replace(geom_friction=friction, body_mass=model.body_mass.at[1].set(p[3]))
        push = jnp.full((40, 1), p[4])
        return jaxsim.rollout(changed, state.replace(qvel=p[:2]), push)[0].qpos[0]

    run = quick_jit(lambda p: (final(p), jax.jacfwd(final)(p), jax.jacrev(final)(p)))
    point = jnp.array([*start, 0.5, 2.0, 1.0])
    _, forward, backward = run(point)
    np.testing.assert_allclose(forward, backward, atol=1e-9)
    for i in range(5):
        if start[0] == 0 and i < 2:  # What sticks does not stick any more when it is pushed off.
            continue
        e = jnp.zeros(5).at[i].set(1e-6)
        slope = (run(point + e)[0] - run(point - e)[0]) / 2e-6
        np.testing.assert_allclose(forward[i], slope, rtol=1e-7, atol=1e-8)


def test_what_does_not_combine_is_refused_by_name():
    body = "<body><freejoint/><geom size='1'/></body>"
    xml = f"<mujoco><option {{}}/><worldbody>{body}</worldbody></mujoco>"
    for option, name in (
        ("integrator='RK4'", "RK4"),
        ("integrator='implicitfast'", "IMPLICITFAST"),
        ("noslip_iterations='3'", "noslip_iterations"),
    ):
        with pytest.raises(jaxsim.ModelError, match=f"contact='hard' .*{name}"):
            jaxsim.load(xml.format(option), contact="hard")
    model = point_mass("hard")
    with pytest.raises(jaxsim.ModelError, match="contact='hard' has no forces"):
        jax.eval_shape(jaxsim.inverse, model, jaxsim.make_state(model), jnp.zeros(2))


@pytest.mark.parametrize(
    ("materials", "message"),
    [
        ({"mass": {"restitution": 1.2}}, "restitution of geom 'mass' must be between 0 and 1"),
        ({"mass": {"stiffness": 0}}, "stiffness of geom 'mass' must be positive"),
        ({"mass": {"bounce": 1}}, "geom 'mass' has no 'bounce'; parameters are stiffness"),
        ({"ball": {}}, "there is no geom 'ball'"),
    ],
)
def test_bad_materials_are_refused(materials, message):
    with pytest.raises(ValueError, match=message):
        point_mass("hard", materials=materials)
