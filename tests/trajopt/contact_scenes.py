"""Scenes in which something moves only if it is touched; for optimisers that look for contacts."""

import importlib.resources
import re

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

import jaxsim
from jaxsim import trajopt
from jaxsim.dynamics.kinematics import kinematics

TIMESTEP = 0.05

# A torso, a leg and a foot that touches the ground at toe and heel.
HOPPER = """<mujoco><option timestep="0.05"/>
  <default><joint axis="0 -1 0"/><geom contype="0" conaffinity="1" friction="1"/></default>
  <worldbody><geom name="floor" type="plane" size="0 0 1" contype="1"/>
  <body><joint type="slide" axis="0 0 1"/><joint type="slide" axis="-1 0 0"/><joint/>
    <inertial pos="0 0 0" mass="1" diaginertia=".013 .013 .013"/>
    <body pos="0 0 -.2"><joint name="knee"/>
      <inertial pos="0 0 -.2" mass=".2" diaginertia=".01 .01 .01"/>
      <body pos="0 0 -.4"><joint name="ankle"/>
        <inertial pos=".05 0 0" mass=".1" diaginertia=".005 .005 .005"/>
        <geom name="toe" pos=".15 0 0" size=".03"/><geom name="heel" pos="-.05 0 0" size=".03"/>
  </body></body></body></worldbody>
  <actuator><motor joint="knee"/><motor joint="ankle"/></actuator></mujoco>"""

# A finger beside a box that glides on oil.
PUSHER = """<mujoco><option timestep="0.05" gravity="0 0 0"/>
  <default><geom friction="0.5"/></default>
  <worldbody><body><joint type="slide" axis="1 0 0" damping="4"/>
    <joint type="slide" axis="0 1 0" damping="4"/><joint axis="0 0 1" damping=".05"/>
    <geom name="box" type="box" size=".1 .1 .05" mass="1"/></body>
  <body pos="-.2 0 0"><joint name="x" type="slide" axis="1 0 0"/>
    <joint name="y" type="slide" axis="0 1 0"/><geom name="finger" size=".04" mass=".5"/></body>
  </worldbody><actuator><motor joint="x"/><motor joint="y"/></actuator></mujoco>"""


def quadratic_problem(model, start, goal, *, force, positions=1.0, velocities=0.1, horizon=40):
    """Sums of squares of what is left to the goal, of velocities and of controls."""

    def running_cost(x, u, t):
        left, slow = jnp.sum(positions * (x.qpos - goal) ** 2), jnp.sum(x.qvel**2)
        return TIMESTEP * (left + velocities * slow + force * jnp.sum(u**2))

    def final_cost(x):
        return 10 * jnp.sum(positions * (x.qpos - goal) ** 2) + jnp.sum(x.qvel**2)

    return trajopt.make_problem(
        model, start, horizon=horizon, running_cost=running_cost, final_cost=final_cost
    )


def load(xml, law, stiffness):
    """The model; two of its geoms in touch are a spring of this stiffness (N/m)."""
    each = {"stiffness": 2.0 * stiffness}
    names = re.findall('<geom name="([^"]+)"', xml)
    return jaxsim.load(xml, contact=law, materials=dict.fromkeys(names, each))


def hopper(law="lagged"):
    """Half a metre forwards; the published start and its straight line to the goal."""
    model = load(HOPPER, law, 800)
    home = jnp.array([0.61, 0.0, 0.3, -0.5, 0.2])
    goal = home.at[1].set(-0.5)
    start = jaxsim.make_state(model).replace(qpos=home)
    problem = quadratic_problem(model, start, goal, force=0.1)
    part = jnp.arange(1, 41)[:, None] / 40
    return problem, home[None] + part * (goal - home)[None]


def push(model, goal):
    """The box, from rest at the origin to a pose (x, y, turn); the finger may end anywhere."""
    weights = jnp.array([10.0, 10.0, 1.0, 0.0, 0.0])
    target = jnp.concatenate([goal, jnp.zeros(2)])
    start = jaxsim.make_state(model)
    return quadratic_problem(model, start, target, force=1e-3, positions=weights)


# A ball on the floor before the bundled arm: radius (m), mass (kg), stiffness of contacts (N/m),
# how far the hand is from it at first and how far it shall roll (m), and in how many steps.
RADIUS, BALL, STIFF, APART, ROLL, STEPS = 0.1, 0.3, 1000.0, 0.01, 0.15, 20
HAND, ABOVE, PLACE = 0.045, 0.03, 0.45  # radius of the hand, its height above the middle; first x


def arm_and_ball():
    """The arm with motors that need not carry it; the ball touches hand and floor only."""
    spec = mujoco.MjSpec.from_file(str(importlib.resources.files("jaxsim") / "assets/arm.xml"))
    spec.option.timestep, spec.option.iterations, spec.option.ls_iterations = TIMESTEP, 100, 50
    spec.option.tolerance = 1e-12
    for element in [*spec.actuators, *spec.keys]:
        spec.delete(element)
    for body in spec.bodies:
        body.gravcomp = float(body.name.startswith("link"))
    for geom in spec.geoms:
        geom.contype = geom.conaffinity = 0
    for joint in spec.joints:
        motor = spec.add_actuator(name=joint.name, target=joint.name)
        motor.set_to_motor()
        motor.trntype, motor.gear[0] = mujoco.mjtTrn.mjTRN_JOINT, 10
        motor.forcelimited = motor.ctrllimited = 0
    ball = spec.worldbody.add_body(name="ball", pos=[0, 0, RADIUS])
    ball.add_freejoint()
    sphere = {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": [RADIUS, 0, 0], "mass": BALL}
    ball.add_geom(name="ball", contype=0, conaffinity=0, **sphere)
    for other in ("floor", "hand"):
        pair = spec.add_pair(geomname1=other, geomname2="ball", condim=3)
        pair.friction[:2] = 0.5
    soft = {name: {"stiffness": 2 * STIFF} for name in ("floor", "hand", "ball")}
    return jaxsim.load(spec.compile(), contact="lagged", materials=soft)


def roller():
    """The arm shall roll the ball; a path on which the hand follows the ball, which rolls."""
    model, part = arm_and_ball(), np.linspace(0, 1, STEPS + 1)
    sunk = BALL * 9.81 / STIFF
    rolled = ROLL * (3 * part**2 - 2 * part**3)
    behind = np.sqrt((RADIUS + HAND) ** 2 - ABOVE**2) + APART * np.maximum(0, 1 - part / 0.2)
    targets = np.stack([PLACE + rolled - behind, 0 * part, 0 * part + RADIUS + ABOVE], axis=1)
    rest = jnp.array([PLACE, 0, RADIUS - sunk, 1, 0, 0, 0])
    half = rolled / RADIUS / 2
    ball = np.stack([PLACE + rolled, 0 * part, 0 * part + RADIUS - sunk, np.cos(half)], axis=1)
    ball = np.concatenate([ball, np.stack([0 * half, np.sin(half), 0 * half], axis=1)], axis=1)

    def nearer(joints, target):
        def miss(joints):
            return kinematics(model, jnp.concatenate([joints, rest])).site_xpos[0] - target

        slope = jax.jacfwd(miss)(joints)
        return joints - slope.T @ jnp.linalg.solve(
            slope @ slope.T + 1e-6 * jnp.eye(3), miss(joints)
        )

    def follow(joints, target):
        joints = jax.lax.fori_loop(0, 30, lambda _, joints: nearer(joints, target), joints)
        return joints, joints

    _, joints = jax.jit(lambda at: jax.lax.scan(follow, at, jnp.asarray(targets)))(
        jnp.array([0, 0.9, 0, 1.2, 0, 0.8, 0])
    )
    path = jnp.concatenate([joints, ball], axis=1)
    goal = jnp.array([PLACE + ROLL, 0])

    def running_cost(x, u, t):
        left = 10 * jnp.sum((x.qpos[7:9] - goal) ** 2) + 0.01 * jnp.sum(u**2)
        return TIMESTEP * (left + 0.05 * jnp.sum(x.qvel[:9] ** 2))

    def final_cost(x):
        left = 100 * jnp.sum((x.qpos[7:9] - goal) ** 2) + 2 * jnp.sum(x.qvel[7:9] ** 2)
        return left + 0.1 * jnp.sum(x.qvel[:7] ** 2)

    start = jaxsim.make_state(model).replace(qpos=path[0])
    problem = trajopt.make_problem(
        model, start, horizon=STEPS, running_cost=running_cost, final_cost=final_cost
    )
    return problem, path[1:]


# A box on a table that moves as slowly as it is pushed: half sizes (m), weight times friction (N),
# radius of its friction against turning (m), and the time step (s).
LENGTH, WIDTH, GRIP, TURN, STEP = 0.5, 0.25, 0.5 * 9.8, 0.4 * np.hypot(0.5, 0.25), 0.02


def slide(x, w):
    """The box pushed at a point (x, y) of its own axes, on four sides with forces w[2:]."""
    (x_at, y_at), (up, right, down, left) = w[:2], w[2:]
    along, across = right - left, up - down
    c, s = jnp.cos(x[2]), jnp.sin(x[2])
    twist = (x_at * across - y_at * along) / TURN
    turned = jnp.stack([c * along - s * across, s * along + c * across, twist])
    return x + STEP / GRIP * turned


def touching_one_side(x, w, y):
    """A side is pushed only if the point is on it, and no other side is."""
    (x_at, y_at), forces = w[:2], w[2:]
    distance = jnp.stack([y_at + WIDTH, x_at + LENGTH, WIDTH - y_at, LENGTH - x_at])
    return forces, distance + 0.1 * (forces.sum() - forces)


def sliding_box(goal):
    """The box shall go to a pose, from the origin in two seconds."""
    most = np.array([LENGTH, WIDTH, np.inf, np.inf, np.inf, np.inf])
    return trajopt.make_problem(
        slide,
        jnp.zeros(3),
        horizon=100,
        running_cost=lambda x, w, t: 1e-3 * jnp.sum(w[2:] ** 2),
        final_cost=lambda x: 100 * jnp.sum((x - goal) ** 2),
        control_limits=(-most, most),
        complementarity=touching_one_side,
    )
