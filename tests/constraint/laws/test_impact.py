"""Times of impact and restitution: closed forms at time steps that are long for them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.constraint.rigid.impact import Approach, impact

G, STEP = 9.81, 0.02

# A mass that slides and falls; its height is that of its lowest point.
SLIDER = f"""<mujoco><option timestep="{STEP}" gravity="0 0 -{G}"/><worldbody>
  <geom type="plane" size="0 0 1" friction=".1"/>
  <body pos="0 0 .1"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
    <geom size=".1" friction=".1"/></body></worldbody></mujoco>"""

BALL = """<body pos="{} 0 0"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body>"""


def balls(positions):
    """Balls on a line without gravity, each in contact with the next only at its positions."""
    bodies = "".join(BALL.format(x) for x in positions)
    return f"""<mujoco><option timestep="{STEP}" gravity="0 0 0"/><worldbody>{bodies}</worldbody>
      <default><geom margin=".1"/></default></mujoco>"""


def with_restitution(model, e):
    """The model with the same restitution everywhere."""
    return model.replace(geom_restitution=jnp.full_like(model.geom_restitution, e))


def step_of(model):
    """A step of (e, g, qpos, qvel)."""

    def step(e, g, qpos, qvel):
        opt = model.opt.replace(gravity=jnp.array([0, 0, -1.0]) * g)
        changed = with_restitution(model, e).replace(opt=opt)
        state = jaxsim.make_state(model).replace(qpos=qpos, qvel=qvel)
        after, status = jaxsim.step_with_status(changed, state)
        return after.qpos, after.qvel, status

    return step


def stepper(model):
    """The same, compiled."""
    return quick_jit(step_of(model))


def trajectory(step, e, g, qpos, qvel, count):
    """Positions and velocities after each step; every solve converges."""
    qpos, qvel = (jnp.asarray(x, float) for x in (qpos, qvel))
    found = []
    for _ in range(count):
        qpos, qvel, status = step(e, g, qpos, qvel)
        assert status.converged
        found.append((qpos, qvel))
    return tuple(np.stack(x) for x in zip(*found, strict=True))


def test_bounces_have_their_closed_forms(x64):
    """Elastic without gravity, once and twice with it, restitution of energy, and the end."""
    step = stepper(jaxsim.load(SLIDER, contact="hard"))
    height = lambda *args: trajectory(step, *args)[0][:, 1]  # noqa: E731
    np.testing.assert_allclose(height(1, 0, [0, 1.0], [0, -2], 50)[-1], 1.0, atol=1e-10)
    # The cases G2, G2b and G13 are of a ball whose centre is at 1 m.
    one = height(0.8, G, [0, 0.9], [0, 0], 65)
    np.testing.assert_allclose(one[39] + 0.1, 0.671884927515, atol=1e-10)
    np.testing.assert_allclose(one[64] + 0.1, 0.430773412982, atol=1e-10)
    # With friction's impulse: it begins at 3 m/s, and slides on without touching.
    x = trajectory(step, 0.8, G, [0, 0.9], [3, 0], 40)[0][-1, 0]
    np.testing.assert_allclose(x, 2.11889150725, atol=1e-10)
    for e in (0.5, 0.8):
        qpos, qvel = trajectory(step, e, 10.0, [0, 1.0], [0, 0], 30)
        top = qpos[-1, 1] + qvel[-1, 1] ** 2 / 20
        np.testing.assert_allclose(top, e**2, atol=1e-9)
    # Infinitely many bounces end at sqrt(2 H / g) (1 + e) / (1 - e).
    qpos, qvel = trajectory(step, 0.5, G, [0, 0.9], [0, 0], 70)
    after = STEP * np.arange(1, 71) > np.sqrt(1.8 / G) * 3
    assert np.abs(qvel[after]).max() < 1e-9
    np.testing.assert_allclose(qpos[after, 1], 0, atol=1e-9)


def test_slides_to_rest_where_coulomb_says(x64):
    """Case G7 at a step of 4 ms."""
    model = jaxsim.load(SLIDER, contact="hard")
    opt = model.opt.replace(timestep=jnp.asarray(0.004))
    friction = jnp.full_like(model.geom_friction, 0.5)
    step = stepper(model.replace(opt=opt, geom_friction=friction))
    qpos, _ = trajectory(step, 0.0, G, [0, 0], [2, 0], 110)
    np.testing.assert_allclose(qpos[-1, 0], 0.407747196738, atol=1e-5)
    assert np.abs(qpos[:, 1]).max() < 1e-10


@pytest.mark.parametrize(
    ("gap", "after"), [(0.05, (0, 0, 1)), (0.0, (-1 / 3, 2 / 3, 2 / 3))], ids=["apart", "touching"]
)
def test_three_balls_in_a_row(gap, after, x64):
    """Apart, they hand the speed on; where they touch, Newton's law holds at both contacts."""
    model = jaxsim.load(balls([0, 0.23 + gap, 0.43 + 2 * gap]), contact="hard")
    step = stepper(model)
    _, qvel = trajectory(step, 1.0, 0.0, [0, 0, 0], [1, 0, 0], 15)
    np.testing.assert_allclose(qvel[-1], after, atol=1e-10)


def test_one_contact_moves_as_in_continuous_time():
    """Many random approaches, against bounces that are followed one by one."""
    rng = np.random.default_rng(0)
    n, h = 400, 0.03
    phi, v = rng.uniform(0, 0.03, n), rng.normal(-0.5, 0.7, n)
    a, e = rng.uniform(-12, 3, n), rng.uniform(0, 1, n)
    found = impact(h, Approach(phi, v, e, np.ones(n)), a)
    found = jax.tree.map(np.asarray, found)
    free = v + h * a
    jump = np.maximum(found.target - free, 0)
    end = phi + h * (v + free + jump) / 2 + found.lever * jump
    expected = np.array([_followed(*x, h) for x in zip(phi, v, a, e, strict=True)])
    bounces = expected[:, 2]
    assert min(np.sum(bounces == 0), np.sum(bounces == 1)) > 50
    simple = bounces <= 1
    np.testing.assert_allclose(end[simple], expected[simple, 0], atol=1e-6)
    np.testing.assert_allclose((free + jump)[simple], expected[simple, 1], atol=1e-5)
    # What bounces again within the step rests.
    np.testing.assert_allclose(end[~simple], 0, atol=1e-6)
    assert (found.lever[bounces == 0] == 0).all()


def _followed(phi, v, a, e, h):
    """Position and velocity at h, and the number of bounces, one after the other; 2 for rest."""
    bounces = 0
    while bounces < 2:
        roots = np.roots([a / 2, v, phi]) if bounces == 0 else np.array([-2 * v / a])
        roots = roots[np.isreal(roots)].real
        roots = roots[(roots > 0) & (roots < h)]
        if not len(roots) or phi + v * h + a * h * h / 2 >= 0:
            return phi + v * h + a * h * h / 2, v + a * h, bounces
        t = roots.min()
        phi, v, h, bounces = 0.0, -e * (v + a * t), h - t, bounces + 1
    return 0.0, 0.0, bounces


@pytest.mark.slow
@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev], ids=["forward", "reverse"])
def test_derivatives_are_those_of_the_continuous_motion(mode, x64):
    """By height, speed, restitution and gravity, through one and two bounces (G2, G2b, G13)."""
    step = step_of(jaxsim.load(SLIDER, contact="hard"))

    def one(x):
        # x: (e, g, qpos, qvel)
        qpos, qvel, _ = step(x[0], x[1], x[2:4], x[4:])
        return jnp.concatenate([x[:2], qpos, qvel])

    slope = quick_jit(lambda x: (one(x), mode(one)(x)))
    x, total = jnp.array([0.8, G, 0, 0.9, 3, 0]), np.eye(6)
    totals = []
    for _ in range(65):
        x, J = slope(x)
        total = np.asarray(J) @ total
        totals.append(total)
    e, g, _, z0, vx, v0 = np.moveaxis(np.array(totals), 2, 0)
    by = np.stack([z0, v0, e, g], axis=-1)
    height, x = by[:, 3], by[:, 2]
    once = [0.761713848619, 0.0289647136194, 1.56171384862, -0.0115858854478]
    np.testing.assert_allclose(height[39], once, atol=1e-7)
    twice = [-0.254986992788, -0.0878635154851, 0.514026014424, 0.0571112850653]
    np.testing.assert_allclose(height[64], twice, atol=1e-7)
    np.testing.assert_allclose(vx[39, 2], 0.8, atol=1e-7)
    np.testing.assert_allclose(x[39, [0, 2]], [0.0238286151381, -0.156171384862], atol=1e-7)
