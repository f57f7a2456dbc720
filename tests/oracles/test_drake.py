"""Contact `sap` beside Drake's, one step in each scene (extra `oracles`).

Drake makes the regularisation of a contact from `|J A^-1 J^T| / 3`, the norm of its own inverse
inertia; here it is from a mean of each body. So the test gives Drake's number to our bodies.
"""

import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

pytestmark = pytest.mark.slow
STEP, STIFFNESS, RELAXATION, FRICTION, RADIUS, ARM = 0.01, 2e4, 0.01, 0.5, 0.1, 0.4
DEPTHS = 1e-4, 2e-4

GROUND = f"""<mujoco><option timestep="{STEP}"/><default><geom friction="{FRICTION}"/></default>
  <worldbody><geom name="ground" type="plane" size="0 0 1"/>{{}}</worldbody></mujoco>"""
SPHERE = '<body pos="0 0 {}"><freejoint/><geom size=".1" mass="{}"/></body>'
PENDULUM = f"""<body pos="0 0 {RADIUS - DEPTHS[0]}"><joint axis="0 1 0"/>
  <geom size=".1" mass="2" pos="{ARM} 0 0"/></body>"""


def ours(bodies, weights, qvel):
    """Velocities after a step; `weights` are the inverse inertias of the bodies."""
    model = jaxsim.load(GROUND.format(bodies), contact="sap")
    everywhere = lambda x: jnp.full(model.ngeom, x)  # noqa: E731
    # Two springs in series, two times of relaxation.
    model = model.replace(
        geom_stiffness=everywhere(2 * STIFFNESS),
        geom_relaxation=everywhere(RELAXATION / 2),
        body_invweight0=model.body_invweight0.at[1:, 0].set(jnp.asarray(weights)),
    )
    state = jaxsim.make_state(model).replace(qvel=jnp.asarray(qvel, float))
    return quick_jit(lambda state: jaxsim.step(model, state))(state).qvel


class Drake:
    """Scenes on the same ground."""

    def __init__(self):
        pytest.importorskip("pydrake", reason="needs the extra `oracles`")
        from pydrake import geometry, math
        from pydrake.multibody import plant, tree
        from pydrake.systems.framework import DiagramBuilder

        self.geometry, self.tree, self.pose = geometry, tree, math.RigidTransform
        self.friction = plant.CoulombFriction(FRICTION, FRICTION)
        self.builder = DiagramBuilder()
        self.plant, _ = plant.AddMultibodyPlantSceneGraph(self.builder, STEP)
        self.plant.set_discrete_contact_approximation(plant.DiscreteContactApproximation.kSap)
        self._add(self.plant.world_body(), geometry.HalfSpace(), 0.0)

    def sphere(self, mass, x=0.0):
        """A body with a sphere at x."""
        inertia = self.tree.UnitInertia.SolidSphere(RADIUS).ShiftFromCenterOfMass([-x, 0, 0])
        name = f"body{self.plant.num_bodies()}"
        body = self.plant.AddRigidBody(
            name, self.tree.SpatialInertia(mass, np.array([x, 0, 0]), inertia)
        )
        self._add(body, self.geometry.Sphere(RADIUS), x)
        return body

    def _add(self, body, shape, x):
        properties = self.geometry.ProximityProperties()
        self.geometry.AddContactMaterial(
            dissipation=0.0,
            point_stiffness=2 * STIFFNESS,
            friction=self.friction,
            properties=properties,
        )
        properties.AddProperty("material", "relaxation_time", RELAXATION / 2)
        pose, name = self.pose(np.array([x, 0, 0])), f"geometry of {body.name()}"
        self.plant.RegisterCollisionGeometry(body, pose, shape, name, properties)

    def after(self, velocities, heights=()):
        """Velocities after a step; `heights` are those of the free bodies."""
        from pydrake.systems.analysis import Simulator

        self.plant.Finalize()
        diagram = self.builder.Build()
        whole = diagram.CreateDefaultContext()
        context = self.plant.GetMyMutableContextFromRoot(whole)
        for body, z in heights:
            self.plant.SetFreeBodyPose(context, body, self.pose(np.array([0, 0, z])))
        self.plant.SetVelocities(context, np.asarray(velocities, float))
        Simulator(diagram, whole).AdvanceTo(STEP)
        return self.plant.GetVelocities(context)


def weight(*masses, depth):
    """`|J A^-1 J^T| / 3` of a contact between spheres of these masses."""
    arm = RADIUS - depth / 2
    rows = np.array([1, *[1 + arm**2 / (0.4 * RADIUS**2)] * 2])
    return np.linalg.norm(rows * sum(1 / m for m in masses)) / 3


@pytest.fixture(autouse=True)
def accurate(x64):
    """Both solve to rounding; Drake's gravity is MuJoCo's."""


@pytest.mark.parametrize("speed", [0.0, 1e-3, 1.0], ids=["rests", "sticks", "slides"])
def test_a_sphere_on_the_ground(speed):
    z, drake = RADIUS - DEPTHS[0], Drake()
    body = drake.sphere(2.0)
    spin, _, *linear = np.split(drake.after([0, 0, 0, speed, 0, 0], [(body, z)]), [3, 3])
    found = ours(SPHERE.format(z, 2.0), [weight(2.0, depth=DEPTHS[0])], [speed, 0, 0, 0, 0, 0])
    np.testing.assert_allclose(found, [*linear[0], *spin], atol=1e-8)


def test_spheres_on_each_other():
    masses, drake = (2.0, 1.0), Drake()
    heights = RADIUS - DEPTHS[0], 3 * RADIUS - sum(DEPTHS)
    bodies = [drake.sphere(m) for m in masses]
    theirs = drake.after([0, 0, 0, 1, 0, 0, *np.zeros(6)], zip(bodies, heights, strict=True))
    first, both = weight(2.0, depth=DEPTHS[0]), weight(*masses, depth=DEPTHS[1])
    xml = "".join(map(SPHERE.format, heights, masses))
    found = ours(xml, [first, both - first], [1, *np.zeros(11)])
    theirs = theirs.reshape(2, 2, 3)[:, ::-1].reshape(-1)  # its rotations come first
    np.testing.assert_allclose(found, theirs, atol=1e-8)


def test_an_arm_on_the_ground():
    drake = Drake()
    body, world = drake.sphere(2.0, ARM), drake.plant.world_body()
    frame = drake.pose(np.array([0, 0, RADIUS - DEPTHS[0]]))
    drake.plant.AddJoint(
        drake.tree.RevoluteJoint(
            "hinge",
            drake.plant.AddFrame(drake.tree.FixedOffsetFrame("pivot", world.body_frame(), frame)),
            body.body_frame(),
            [0, 1, 0],
        )
    )
    lever = (RADIUS - DEPTHS[0] / 2) ** 2 + ARM**2
    w = lever / (2.0 * (0.4 * RADIUS**2 + ARM**2)) / 3
    np.testing.assert_allclose(ours(PENDULUM, [w], [0.3]), drake.after([0.3]), atol=1e-8)
