"""Random models, and models of one shape in any size; all reproducible from their arguments.

`random_model` writes MJCF text. Each feature is a flag, so that one test asks for smooth dynamics
only and another for everything that makes constraints. Everything is of moderate size (lengths
near 0.3 m, masses near 1 kg), which keeps comparisons with fixed tolerances meaningful.
"""

import dataclasses
import xml.etree.ElementTree as ET

import mujoco
import numpy as np

# Joints that one body may have; a free joint is for children of the world.
JOINT_SETS = (
    ("hinge",),
    ("slide",),
    ("ball",),
    ("hinge", "hinge"),
    ("slide", "hinge"),
    ("hinge", "slide", "hinge"),
    ("slide", "ball"),
    ("hinge", "hinge", "hinge"),
)


@dataclasses.dataclass(frozen=True)
class Features:
    """What a random model contains; by default all that acts without constraints.

    Attributes:
      bodies: number of bodies with joints.
      trees: how many of them are children of the world.
      free: trees may start with a free joint.
      multiple: bodies may have several joints.
      welded: some bodies carry further bodies without joints, as the world does.
      massless: some bodies with joints have no mass of their own, only what is welded to them.
      armature, damping, stiffness, poly, gravcomp, fluid: forces on joints and bodies.
      sites: every body has one.
      tendons: fixed tendons, with springs and dampers if joints have them.
      actuators: motors, position and velocity servos, filters.
      mocap: a mocap body that carries a tree.
      options: gravity points in a random direction.
      frictionloss, limits: dry friction in joints and tendons, ranges of joints and tendons.
      equality: connect, weld, joint and tendon constraints.
      contacts: a floor and collision geoms; with `self_collision` among bodies too.
    """

    bodies: int = 8
    trees: int = 2
    free: bool = True
    multiple: bool = True
    welded: bool = True
    massless: bool = True
    armature: bool = True
    damping: bool = True
    stiffness: bool = True
    poly: bool = False
    gravcomp: bool = False
    fluid: bool = False
    sites: bool = True
    tendons: bool = True
    actuators: bool = True
    mocap: bool = False
    options: bool = True
    frictionloss: bool = False
    limits: bool = False
    equality: bool = False
    contacts: bool = False
    self_collision: bool = False


CONSTRAINED = Features(
    bodies=6,
    frictionloss=True,
    limits=True,
    equality=True,
    contacts=True,
    options=False,
)


def random_model(seed: int, features: Features | None = None, **changes) -> str:
    """MJCF text of a random model.

    Args:
      seed: the same seed and features give the same text.
      features: what it contains.
      changes: fields of `features` to replace.
    """
    features = dataclasses.replace(features or Features(), **changes)
    writer = _Writer(np.random.default_rng(seed), features)
    return ET.tostring(writer.write(), encoding="unicode")


def random_states(mj: mujoco.MjModel, seed: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """(n, nq) coordinates and (n, nv) velocities, about half a unit away from rest at `qpos0`."""
    rng = np.random.default_rng(seed)
    qpos = np.tile(mj.qpos0, (n, 1))
    for q in qpos:
        mujoco.mj_integratePos(mj, q, 0.5 * rng.standard_normal(mj.nv), 1.0)
    return qpos, 0.5 * rng.standard_normal((n, mj.nv))


def chain(n: int, joint: str = "hinge") -> mujoco.MjModel:
    """n bodies in a row, axes alternating."""
    return from_parents([i - 1 for i in range(n)], [joint] * n)


def binary_tree(n: int) -> mujoco.MjModel:
    """n bodies, each with two children as long as there are bodies left."""
    return from_parents([(i - 1) // 2 for i in range(n)], ["hinge"] * n)


def star(n: int) -> mujoco.MjModel:
    """One free body with n children."""
    return from_parents([-1] + [0] * n, ["free"] + ["hinge"] * n)


def forest(trees: int, length: int) -> mujoco.MjModel:
    """Several equal chains on the world."""
    parent = [-1 if i % length == 0 else i - 1 for i in range(trees * length)]
    return from_parents(parent, ["hinge"] * len(parent))


def from_parents(parent: list[int], joints: list[str]) -> mujoco.MjModel:
    """Bodies with one joint each; deeper than what XML may be.

    Args:
      parent: for each body an earlier one, or -1 for the world.
      joints: for each body the type of its joint.
    """
    spec = mujoco.MjSpec()
    spec.option.gravity = (0.5, 0, -9.81)
    bodies = []
    for i, (above, joint) in enumerate(zip(parent, joints, strict=True)):
        carrier = spec.worldbody if above < 0 else bodies[above]
        body = carrier.add_body(name=f"body{i}", pos=(0.1, 0.02 * (i % 5), -0.1))
        kind = getattr(mujoco.mjtJoint, f"mjJNT_{joint.upper()}")
        body.add_joint(type=kind, axis=np.eye(3)[i % 3], armature=0.0 if joint == "free" else 0.01)
        body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.04, 0, 0), pos=(0.03, 0, -0.05))
        bodies.append(body)
    return spec.compile()


class _Writer:
    """Builds the XML from random choices."""

    def __init__(self, rng: np.random.Generator, features: Features):
        self.rng = rng
        self.has = features
        self.bodies: list[ET.Element] = []
        self.joints: list[tuple[str, str]] = []
        self.root = ET.Element("mujoco")
        ET.SubElement(self.root, "compiler", angle="radian", autolimits="true")
        self.world = ET.Element("worldbody")

    def write(self) -> ET.Element:
        self._option()
        self.root.append(self.world)
        if self.has.contacts:
            _add(self.world, "geom", type="plane", size=(5, 5, 0.1), pos=(0, 0, -0.2))
        if self.has.welded:
            self._welded(self.world, "fixed")
        for i in range(self.has.bodies):
            self._body(i)
        if self.has.tendons:
            self._tendons()
        if self.has.equality:
            self._equalities()
        if self.has.actuators:
            self._actuators()
        return self.root

    def _option(self):
        option = _add(self.root, "option", timestep=0.002)
        if self.has.options:
            _set(option, gravity=self.rng.normal(0, 5, 3))
        if self.has.fluid:
            _set(option, density=1.2, viscosity=0.1, wind=self.rng.normal(0, 1, 3))

    def _body(self, i: int):
        top = i < self.has.trees
        parent = self._base(i) if top else self.bodies[self.rng.integers(len(self.bodies))]
        free = top and self.has.free and i % 2 == 0
        body = _add(parent, "body", name=f"body{i}", pos=self._vector(), quat=self._quat())
        if self.has.gravcomp:
            _set(body, gravcomp=self.rng.uniform(0, 1))
        kinds = ("free",) if free else self._joint_set()
        for kind in kinds:
            self._joint(body, kind)
        massless = self.has.massless and self.rng.random() < 0.25
        if not massless:
            self._inertial(body)
        self._furnish(body, f"{i}")
        if massless or (self.has.welded and self.rng.random() < 0.3):
            self._welded(body, f"welded{i}")
        self.bodies.append(body)

    def _base(self, i: int) -> ET.Element:
        """The world, or for one tree without a free joint a mocap body."""
        if not (self.has.mocap and i == 1):
            return self.world
        mocap = _add(self.world, "body", name="mocap", mocap="true", pos=self._vector())
        _add(mocap, "geom", size=0.02, contype=0, conaffinity=0)
        return mocap

    def _joint_set(self) -> tuple[str, ...]:
        choices = JOINT_SETS if self.has.multiple else JOINT_SETS[:3]
        # Every kind once before chance decides.
        seen = len(self.bodies)
        return choices[seen % len(choices) if seen < 4 else self.rng.integers(len(choices))]

    def _joint(self, body: ET.Element, kind: str):
        name = f"joint{len(self.joints)}"
        self.joints.append((name, kind))
        joint = _add(body, "joint", name=name, type=kind)
        if kind != "free":
            _set(joint, axis=self._unit(), pos=0.3 * self._vector())
        if self.has.limits and kind != "free":
            _set(joint, range=(0, 0.6) if kind == "ball" else (-0.4, 0.5))
        for flag, scale in (("armature", 0.1), ("damping", 0.5), ("frictionloss", 0.2)):
            if getattr(self.has, flag) and kind != "free":
                _set(joint, **{flag: self.rng.uniform(0, scale)})
        if self.has.stiffness:
            poly = self.rng.uniform(0, 1, 2) if self.has.poly else ()
            _set(joint, stiffness=(self.rng.uniform(0, 5), *poly))
        if kind in ("hinge", "slide"):
            _set(joint, ref=self.rng.normal(0, 0.2), springref=self.rng.normal(0, 0.2))

    def _inertial(self, body: ET.Element):
        # Principal moments of three pairs of point masses obey the triangle inequality.
        masses = self.rng.uniform(0.2, 1.5, 3)
        x = self.rng.uniform(0.05, 0.2, 3) ** 2 * masses
        _add(
            body,
            "inertial",
            mass=masses.sum(),
            pos=0.3 * self._vector(),
            quat=self._quat(),
            diaginertia=(x[1] + x[2], x[2] + x[0], x[0] + x[1]),
        )

    def _welded(self, body: ET.Element, name: str):
        child = _add(body, "body", name=name, pos=self._vector(), quat=self._quat())
        self._inertial(child)
        self._furnish(child, name)

    def _furnish(self, body: ET.Element, name: str):
        if self.has.sites:
            _add(body, "site", name=f"site{name}", pos=0.3 * self._vector(), quat=self._quat())
        kind = self.rng.choice(["sphere", "capsule"])
        size = (0.05,) if kind == "sphere" else (0.04, 0.08)
        geom = _add(body, "geom", type=kind, size=size, pos=0.3 * self._vector(), quat=self._quat())
        collides = self.has.contacts and not name.startswith("fixed")
        _set(geom, contype=int(collides), conaffinity=int(collides and self.has.self_collision))
        if self.has.contacts:
            _set(geom, friction=(self.rng.uniform(0.3, 1.2), 0.01, 0.001))
            _set(geom, condim=self.rng.choice([1, 3, 4, 6]))

    def _scalars(self) -> list[str]:
        return [name for name, kind in self.joints if kind in ("hinge", "slide")]

    def _tendons(self):
        names = self._scalars()
        if len(names) < 2:
            return
        tendons = ET.SubElement(self.root, "tendon")
        for i in range(2):
            tendon = _add(tendons, "fixed", name=f"tendon{i}")
            for flag, value in (("stiffness", 3.0), ("damping", 0.2), ("frictionloss", 0.1)):
                if getattr(self.has, flag):
                    _set(tendon, **{flag: value})
            if self.has.limits and i == 0:
                _set(tendon, range=(-0.3, 0.3))
            for name in self.rng.choice(names, 2, replace=False):
                _add(tendon, "joint", joint=name, coef=self.rng.uniform(-2, 2))

    def _actuators(self):
        names = self._scalars()
        actuators = ET.SubElement(self.root, "actuator")
        for i, name in enumerate(names[:4]):
            gear = self.rng.uniform(0.5, 2)
            kind = ("motor", "position", "velocity", "general")[i % 4]
            actuator = _add(actuators, kind, joint=name, gear=gear, ctrlrange=(-1, 1))
            if kind == "general":
                _set(actuator, dyntype="filter", dynprm=0.1, gainprm=2)
            if self.has.armature and i == 0:
                _set(actuator, armature=0.02)

    def _equalities(self):
        equality = ET.SubElement(self.root, "equality")
        ends = {"body1": f"body{self.has.bodies - 1}", "body2": "body0"}
        _add(equality, "connect", **ends, anchor=0.3 * self._vector(), solref=(0.05, 1))
        _add(equality, "weld", body1=f"body{self.has.trees}", solref=(0.1, 1))
        names = self._scalars()
        if len(names) >= 2:
            _add(equality, "joint", joint1=names[0], joint2=names[-1], polycoef=(0, 0.5, 0.1, 0, 0))
            if self.has.tendons:
                _add(equality, "tendon", tendon1="tendon1", polycoef=(0.1, 0, 0, 0, 0))

    def _vector(self) -> np.ndarray:
        return self.rng.uniform(-0.3, 0.3, 3)

    def _unit(self) -> np.ndarray:
        v = self.rng.standard_normal(3)
        return v / np.linalg.norm(v)

    def _quat(self) -> np.ndarray:
        q = self.rng.standard_normal(4)
        return q / np.linalg.norm(q)


def _add(parent: ET.Element, tag: str, **attributes) -> ET.Element:
    element = ET.SubElement(parent, tag)
    _set(element, **attributes)
    return element


def _set(element: ET.Element, **attributes) -> None:
    for name, value in attributes.items():
        words = [value] if np.ndim(value) == 0 else value
        element.set(name, " ".join(w if isinstance(w, str) else f"{w:.17g}" for w in words))
