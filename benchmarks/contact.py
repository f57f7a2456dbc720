"""Laws of contact side by side, and beside MuJoCo C: errors against closed forms, and speed.

A mass slides to rest, slides down a slope, and is pushed below the limit of friction. Its errors
are those of each law in float64 for a short and a long time step. Steps per second are those of
balls in a box, a grasp, the humanoid and a heap of forty spheres and boxes in float32, of whole
batches on one thread; for the heap also those of Drake, where it is installed.
"""

import argparse
import importlib.util
from collections.abc import Callable

import common
import mujoco
import numpy as np

LAWS = "mujoco", "sap", "lagged", "hard"
G, SPEED, SLOPE = 9.81, 2.0, np.radians(25)
MASS = f"""<mujoco><option gravity="0 0 -{G}" cone="elliptic"/><worldbody>
  <geom type="plane" size="0 0 1" friction=".5"/>
  <body pos="0 0 .1"><joint name="x" type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
    <geom size=".1" mass="1" friction=".5"/></body></worldbody>
  <actuator><motor joint="x"/></actuator></mujoco>"""

_BALL = '<body pos="{} {} {}"><freejoint/><geom size=".1" mass="{}"/></body>'
_BOX = '<body pos="{} {} {}"><freejoint/><geom type="box" size=".1 .08 .06" mass="{}"/></body>'
_WALL = '<geom type="plane" size="0 0 1" pos="{0} {1} 0" zaxis="{2} {3} .3"/>'
_PAD = """<body pos="{0} 0 0"><joint name="{1}" type="slide" axis="{2} 0 0"/>
  <geom type="box" size=".01 .02 .02" mass=".1" contype="2" conaffinity="1"/></body>"""


def heap(count: int, bodies: tuple[str, ...], side: float, rise: float) -> str:
    """Bodies that fall onto each other between four tilted walls, in turn of these kinds."""
    rng = np.random.default_rng(0)
    places = rng.uniform(-0.25, 0.25, (count, 3))
    places[:, 2] += 0.75 + rise * np.arange(count)
    numbers = np.column_stack([places, rng.uniform(1, 3, count)])
    fallen = "".join(bodies[i % len(bodies)].format(*row) for i, row in enumerate(numbers))
    sides = (1, 0), (-1, 0), (0, 1), (0, -1)
    walls = "".join(_WALL.format(-side * x, -side * y, x, y) for x, y in sides)
    return f"""<mujoco><option timestep=".004" cone="elliptic"/><worldbody>
      <geom type="plane" size="0 0 1"/>{walls}{fallen}</worldbody></mujoco>"""


def grasp() -> str:
    """Two pads hold a capsule of 45 g by friction."""
    pads = _PAD.format(-0.03, "left", 1) + _PAD.format(0.03, "right", -1)
    return f"""<mujoco><option timestep=".002" cone="elliptic" impratio="10"/>
      <default><geom friction=".7"/></default>
      <worldbody>{pads}<body><freejoint/><geom type="capsule" size=".02 .02" mass=".045"
        contype="1" conaffinity="2"/></body></worldbody>
      <actuator><motor joint="left" gear="2"/><motor joint="right" gear="2"/></actuator></mujoco>"""


SCENES: dict[str, Callable[[], object]] = {
    "balls": lambda: heap(4, (_BALL,), 0.4, 0.21),
    "clutter": lambda: heap(40, (_BALL, _BOX), 0.4, 0.12),
    "grasp": grasp,
    "humanoid": lambda: "humanoid",
}


# Environments, where they are not as many as the option says, and seconds before they are timed.
BATCHES, SECONDS = {"clutter": 4}, {"clutter": 2.0}
DRAKE_STEPS = 50


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup()
    errors = _errors(options.steps)
    print(common.table(errors), flush=True)
    rows = []
    for name in options.scenes:
        rows += _rates(name, options)
        print(common.table([r for r in rows if r["scene"] == name]), flush=True)
    common.write(options, __file__, {"errors": errors, "rows": rows})


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=5)
    parser.add_argument("--steps", nargs="+", type=float, default=[0.002, 0.01], metavar="SECONDS")
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--laws", nargs="+", default=["mujoco", "sap", "hard"], choices=LAWS)
    parser.add_argument("--batch", type=int, default=64)
    return parser.parse_args(arguments)


def _errors(steps: list[float]) -> list[dict]:
    """Errors of each engine and law at each time step."""
    import jax

    with jax.enable_x64(True):
        runs = {"MuJoCo C": _run_c} | {law: _run_of(law) for law in LAWS}
        return [{"law": law} | _judged(run, h) for law, run in runs.items() for h in steps]


def _judged(run: Callable, h: float) -> dict:
    """Where a mass stops, how high it is lifted, how far it slides down, and how fast it creeps."""
    count = lambda seconds: round(seconds / h)  # noqa: E731
    level, tilted = (0, 0, -G), (G * np.sin(SLOPE), 0, -G * np.cos(SLOPE))
    stop = run(h, count(0.6), level, 0.5, SPEED, 0.0)
    slope = run(h, count(0.5), tilted, 0.2, 0.0, 0.0)
    push = run(h, count(0.5), level, 0.5, 0.0, 0.25 * G)
    half = count(0.25)
    fall = G * (np.sin(SLOPE) - 0.2 * np.cos(SLOPE)) * (count(0.5) * h) ** 2 / 2
    return {
        "time step": h,
        "stopping distance": abs(stop[-1, 0] - SPEED**2 / (2 * 0.5 * G)),
        "lift": stop[:, 1].max(),
        "slope": abs(slope[-1, 0] - fall),
        "creep m/s": abs(push[-1, 0] - push[half, 0]) / ((len(push) - 1 - half) * h),
    }


def _run_of(law: str) -> Callable:
    """From a motion's parameters to its positions after each step."""
    import jax
    import jax.numpy as jnp

    import jaxsim

    model = jaxsim.load(MASS, contact=law)

    @jax.jit
    def step(h, gravity, friction, state, push):
        opt = model.opt.replace(timestep=h, gravity=gravity)
        friction = model.geom_friction.at[:, 0].set(friction)
        return jaxsim.step(model.replace(opt=opt, geom_friction=friction), state, push)

    def run(h, count, gravity, friction, speed, push):
        state = jaxsim.make_state(model).replace(qvel=jnp.array([speed, 0.0]))
        numbers = [jnp.asarray(x, float) for x in (h, gravity, friction)]
        found = []
        for _ in range(count):
            state = step(*numbers, state, jnp.array([push]))
            found.append(np.asarray(state.qpos))
        return np.array(found)

    return run


def _run_c(h, count, gravity, friction, speed, push) -> np.ndarray:
    mj = mujoco.MjModel.from_xml_string(MASS)
    mj.opt.timestep, mj.opt.gravity[:], mj.geom_friction[:, 0] = h, gravity, friction
    data, found = mujoco.MjData(mj), []
    data.qvel[0], data.ctrl[0] = speed, push
    for _ in range(count):
        mujoco.mj_step(mj, data)
        found.append(data.qpos.copy())
    return np.array(found)


def _rates(name: str, options) -> list[dict]:
    """Steps per second of each law and of MuJoCo C, from a state in which things touch."""
    from jaxsim.io.loading import compile_mujoco

    mj = compile_mujoco(SCENES[name]())
    mj.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    states = _begun(mj, BATCHES.get(name, options.batch), SECONDS.get(name, 0.5))
    made = {law: _ours(mj, law, states) for law in options.laws}
    runs = {law: run for law, (run, *_) in made.items()} | {"MuJoCo C": _c(mj, states)}
    counts = dict.fromkeys(runs, len(states[0]))
    if name == "clutter" and importlib.util.find_spec("pydrake"):
        runs["Drake"] = _drake(mj, *(x[0] for x in states[:2]))
        counts["Drake"] = DRAKE_STEPS
    timings = common.interleave(runs, options.repetitions, clock=options.clock)
    rates = {law: counts[law] / timing.median for law, timing in timings.items()}
    rows = [{"scene": name, "law": law, "steps/s": rate} for law, rate in rates.items()]
    for row in rows[: len(made)]:
        _, seconds, status = made[row["law"]]
        row |= {
            "to MuJoCo C": row["steps/s"] / rates["MuJoCo C"],
            "Newton steps": float(status.iterations.mean()),
            "passes": float(status.passes.mean()),
            "residual": float(np.max(status.rigid_residual)),
            "converged %": 100 * float(status.converged.mean()),
            "compile s": seconds,
        }
    return rows


def _begun(mj, batch: int, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, velocities and controls after some time, with a little noise at the start."""
    rng, found = np.random.default_rng(0), []
    for _ in range(batch):
        data = mujoco.MjData(mj)
        data.qvel[:] = 0.01 * rng.normal(size=mj.nv)
        data.ctrl[:] = 1.0 if mj.nu == 2 else rng.uniform(-0.3, 0.3, mj.nu)
        for _ in range(round(seconds / mj.opt.timestep)):
            mujoco.mj_step(mj, data)
        found.append((data.qpos.copy(), data.qvel.copy(), data.ctrl.copy()))
    return tuple(np.stack(x) for x in zip(*found, strict=True))


def _ours(mj, law: str, states):
    """A compiled step of the batch, the seconds that took, and its status."""
    import jax.numpy as jnp

    import jaxsim

    model = jaxsim.load(mj, contact=law)
    start = jaxsim.make_state(model)

    def step(qpos, qvel, ctrl):
        return jaxsim.step_with_status(model, start.replace(qpos=qpos, qvel=qvel), ctrl)

    run, program, seconds = common.compile_for(jaxsim.vmap(step), *map(jnp.asarray, states))
    return run, seconds, program(*map(jnp.asarray, states))[1]


def _c(mj, states) -> Callable:
    """The same steps by MuJoCo, one after the other."""
    data = mujoco.MjData(mj)

    def run():
        for qpos, qvel, ctrl in zip(*states, strict=True):
            data.qpos[:], data.qvel[:], data.ctrl[:] = qpos, qvel, ctrl
            data.qacc_warmstart[:] = 0
            mujoco.mj_step(mj, data)

    return run


def _drake(mj, qpos, qvel) -> Callable:
    """Steps of free spheres and boxes between planes by Drake, one environment, contact `sap`."""
    from pydrake import geometry, math
    from pydrake.multibody import math as velocities
    from pydrake.multibody import plant, tree
    from pydrake.systems.analysis import Simulator
    from pydrake.systems.framework import DiagramBuilder

    builder, h = DiagramBuilder(), mj.opt.timestep
    system, _ = plant.AddMultibodyPlantSceneGraph(builder, h)
    system.set_discrete_contact_approximation(plant.DiscreteContactApproximation.kSap)
    bodies = [system.world_body()]
    for i in range(1, mj.nbody):
        about = tree.UnitInertia(*(mj.body_inertia[i] / mj.body_mass[i]))
        inertia = tree.SpatialInertia(mj.body_mass[i], np.zeros(3), about)
        bodies.append(system.AddRigidBody(f"body{i}", inertia))
    for i in range(mj.ngeom):
        properties = geometry.ProximityProperties()
        friction = plant.CoulombFriction(*[mj.geom_friction[i, 0]] * 2)
        geometry.AddContactMaterial(
            dissipation=0.0, point_stiffness=2e6, friction=friction, properties=properties
        )
        properties.AddProperty("material", "relaxation_time", h / 2)
        shape = {
            mujoco.mjtGeom.mjGEOM_PLANE: geometry.HalfSpace,
            mujoco.mjtGeom.mjGEOM_SPHERE: lambda r, *_: geometry.Sphere(r),
            mujoco.mjtGeom.mjGEOM_BOX: lambda *half: geometry.Box(*(2 * np.array(half))),
        }[mujoco.mjtGeom(mj.geom_type[i])]
        made = shape() if shape is geometry.HalfSpace else shape(*mj.geom_size[i])
        turn = math.RotationMatrix(_matrix(mj.geom_quat[i]))
        pose = math.RigidTransform(turn, mj.geom_pos[i])
        owner = bodies[mj.geom_bodyid[i]]
        system.RegisterCollisionGeometry(owner, pose, made, f"geom{i}", properties)
    system.Finalize()
    diagram = builder.Build()
    whole = diagram.CreateDefaultContext()
    context = system.GetMyMutableContextFromRoot(whole)
    for body, q, v in zip(bodies[1:], qpos.reshape(-1, 7), qvel.reshape(-1, 6), strict=True):
        turn = math.RotationMatrix(_matrix(q[3:]))
        system.SetFreeBodyPose(context, body, math.RigidTransform(turn, q[:3]))
        spin = velocities.SpatialVelocity(turn.matrix() @ v[3:], v[:3])
        system.SetFreeBodySpatialVelocity(body, spin, context)

    def run():
        start = whole.Clone()
        Simulator(diagram, start).AdvanceTo(DRAKE_STEPS * h)

    return run


def _matrix(quat) -> np.ndarray:
    found = np.zeros(9)
    mujoco.mju_quat2Mat(found, quat)
    return found.reshape(3, 3)


if __name__ == "__main__":
    main()
