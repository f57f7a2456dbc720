"""Scenes in contact beside MuJoCo C, step by step with the same controls.

MuJoCo's solver goes on to the end here (tolerance 0), or its errors would be those in the table.

Of each scene, in float64 and in float32, a row tells

- `finite`: whether all numbers were finite to the end, and `lost`, the most contacts without slot;
- `deepest`: the deepest penetration at the end (m), and `MuJoCo` that of MuJoCo C;
- `apart`: the largest distance of a body at the end from where it is in MuJoCo C (m), and `noise`
  that of two runs of MuJoCo C, one of which starts with positions moved by 1e-12 (1e-7 for
  float32, and rounds its state to that after each step): where this is large, the motion is
  chaotic;
- `energy`: the largest difference of energies along the way, as a share of how much MuJoCo C's
  changes, and `noise energy` that of its two runs;
- `ms`, `MuJoCo ms`: time of a step, with quick options of XLA and with MuJoCo's own, and
  `compile s`.

`support` tells of pairs of shapes: of a body with weak springs that comes to rest on a fixed one,
in a second and in several poses, the largest differences of the wrench that carries it (`force`,
`torque`, as shares of its weight, times 0.1 m) and of its pose (`pos` in m, `turn` in rad), with
two runs of MuJoCo C in `noise`, as above.
"""

import argparse
import copy
import dataclasses
import pathlib
import time
from collections.abc import Callable

import collision_poses
import common
import models
import mujoco
import numpy as np

NOISE = {"float64": 1e-12, "float32": 1e-7}
# Joint angles of Panda with the box between its fingers.
REACHED = np.array([0, 0.4875, 0, -2.3576, 0, 2.8451, -0.7854])
WEIGHT = 9.81  # of the bodies that are carried (N)
SAMPLED = 10  # Energies are compared after so many steps.


@dataclasses.dataclass(frozen=True)
class Scene:
    """A model, and its controls (T, nu) for so many seconds.

    `build` makes the model, of a file if `path` says where in a folder that the command line
    names.
    """

    build: Callable[..., mujoco.MjModel]
    seconds: float
    controls: Callable[[mujoco.MjModel, np.ndarray], np.ndarray]
    path: str = ""


def stack(count: int = 10) -> mujoco.MjModel:
    """Boxes on each other on a plane."""
    boxes = "".join(
        f"""<body pos="0 0 {0.05 + 0.101 * k}"><freejoint/>
        <geom type="box" size=".05 .05 .05"/></body>"""
        for k in range(count)
    )
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><geom type="plane" size="1 1 1"/>{boxes}</worldbody></mujoco>'
    )


def pile(count: int = 50) -> mujoco.MjModel:
    """Shapes of six kinds that fall into a square between walls."""
    rng = np.random.default_rng(0)
    bodies = ""
    for k in range(count):
        layer, row, column = k // 16, k // 4 % 4, k % 4
        place = (0.26 * (column - 1.5), 0.26 * (row - 1.5), 0.3 + 0.3 * layer)
        kind = collision_poses.SHAPES[2 + k % 6]
        pos, quat = ("{} " * n for n in (3, 4))
        bodies += f"""<body pos="{pos.format(*place)}" quat="{quat.format(*rng.normal(size=4))}">
          <freejoint/><geom type="{kind}" {_size(kind)} condim="4"/></body>"""
    walls = "".join(
        f'<geom type="plane" size="1 1 1" pos="{-0.6 * x} {-0.6 * y} 0" zaxis="{x} {y} 0"/>'
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))
    )
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset>{_hull()}</asset><worldbody><geom type="plane" size="1 1 1"/>{walls}
        {bodies}</worldbody></mujoco>"""
    )


def _size(kind: str) -> str:
    return 'mesh="mesh"' if kind == "mesh" else f'size="{collision_poses.SIZES[kind]}"'


def _hull() -> str:
    direction = np.random.default_rng(1).normal(size=(12, 3))
    points = 0.12 * direction / np.linalg.norm(direction, axis=1, keepdims=True)
    return f'<mesh name="mesh" vertex="{" ".join(f"{x:.4f}" for x in points.ravel())}"/>'


def hand_with_cube(path: pathlib.Path) -> mujoco.MjModel:
    """Shadow's hand, with a cube in place of the ellipsoid above its palm."""
    spec = mujoco.MjSpec.from_file(str(path))
    (geom,) = spec.body("object").geoms
    geom.type, geom.size = mujoco.mjtGeom.mjGEOM_BOX, [0.025] * 3
    return spec.compile()


def on_field(path: pathlib.Path) -> mujoco.MjModel:
    """A quadruped on a height field in place of the floor."""
    spec = mujoco.MjSpec.from_file(str(path))
    spec.delete(spec.geom("floor"))
    heights = np.random.default_rng(0).random(21 * 21)
    spec.add_hfield(name="field", nrow=21, ncol=21, size=[2, 2, 0.06, 0.1], userdata=heights)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_HFIELD, hfieldname="field")
    for key in spec.keys:
        x, y, z, *rest = key.qpos
        key.qpos = [x, y, z + 0.06, *rest]
    return spec.compile()


def arm_with_box(path: pathlib.Path) -> mujoco.MjModel:
    """Panda, and a box on the floor in front of it."""
    spec = mujoco.MjSpec.from_file(str(path))
    models.add_box(spec)
    return spec.compile()


def as_it_is(path: pathlib.Path) -> mujoco.MjModel:
    """The model of a file."""
    return mujoco.MjModel.from_xml_path(str(path))


def held(mj: mujoco.MjModel, times: np.ndarray) -> np.ndarray:
    """The controls of the first keyframe."""
    return np.tile(models.start(mj).ctrl, (len(times), 1))


def closing(mj: mujoco.MjModel, times: np.ndarray) -> np.ndarray:
    """From zero to the middle of each actuator's range within a second."""
    return np.minimum(times, 1)[:, None] * mj.actuator_ctrlrange.mean(axis=1)


def picking(mj: mujoco.MjModel, times: np.ndarray) -> np.ndarray:
    """Down to the box, close the fingers, and up again; the last control is the fingers'."""
    home = models.start(mj).ctrl[:7]
    share = np.interp(times, [0, 1, 1.6, 2.6], [0, 1, 1, 0.5])[:, None]
    fingers = np.interp(times, [1.1, 1.3], [255, 0])[:, None]
    return np.hstack([home + share * (REACHED - home), fingers])


SCENES = {
    "stack": Scene(stack, 3, held),
    "pile": Scene(pile, 3, held),
    "hand": Scene(hand_with_cube, 2, closing, "shadow_hand/scene_right.xml"),
    "quadruped": Scene(on_field, 3, held, "unitree_go1/scene.xml"),
    "picking": Scene(arm_with_box, 3, picking, "franka_emika_panda/scene.xml"),
    "muscles": Scene(as_it_is, 1, closing, "hand/myohand.xml"),
}
PAIRS = ["-".join(pair) for pair in collision_poses.PAIRS]


def main(arguments=None) -> None:
    from jaxsim.lanes.switch import enable_lanes

    options = _options(arguments)
    common.setup()
    enable_lanes(False)  # XLA compiles programs that run once sooner.
    record: dict = {"rows": [], "support": []}
    for name in options.scenes:
        scene = SCENES[name]
        folder = options.myo_sim if name == "muscles" else options.menagerie
        if scene.path and folder is None:
            raise SystemExit(f"scene {name} needs {scene.path}: give --menagerie and --myo-sim")
        mj = scene.build(folder / scene.path) if scene.path else scene.build()
        ctrls = scene.controls(
            mj, np.arange(round(scene.seconds / mj.opt.timestep)) * mj.opt.timestep
        )
        for precision in NOISE:
            record["rows"].append({"scene": name} | compared(mj, ctrls, precision))
            print(common.table(record["rows"][-1:]), flush=True)
            common.write(options, __file__, record)
    for pair in options.pairs:
        for precision in NOISE:
            row = support(tuple(pair.split("-")), options.poses, precision)
            record["support"].append(row)
            print(common.table([row]), flush=True)
            common.write(options, __file__, record)


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__ or "", repetitions=1)
    parser.add_argument("--scenes", nargs="*", default=list(SCENES), choices=list(SCENES))
    parser.add_argument("--pairs", nargs="*", default=PAIRS, choices=PAIRS)
    parser.add_argument("--poses", type=int, default=8, help="of each pair")
    parser.add_argument("--menagerie", type=pathlib.Path, help="folder of MuJoCo Menagerie")
    parser.add_argument("--myo-sim", type=pathlib.Path, help="folder of myo_sim")
    return parser.parse_args(arguments)


def compared(mj: mujoco.MjModel, ctrls: np.ndarray, precision: str) -> dict:
    """The row of a scene."""
    import jax
    import jax.numpy as jnp

    import jaxsim

    data = models.start(mj)
    with jax.enable_x64(precision == "float64"):
        model = jaxsim.load(mj)
        state = jaxsim.make_state(model)
        start = state.replace(qpos=jnp.asarray(data.qpos, state.qpos.dtype))

        def roll(start, ctrls):
            _, states, status = jaxsim.rollout(model, start, ctrls, status=True)
            return (states.qpos, states.qvel), status

        arguments = start, jnp.asarray(ctrls, start.qpos.dtype)
        quick = jax.jit(roll, compiler_options=common.quick_options(0))
        began = time.perf_counter()
        run = quick.lower(*arguments).compile()
        seconds = time.perf_counter() - began
        began = time.perf_counter()
        ours, status = jax.tree.map(np.asarray, jax.block_until_ready(run(*arguments)))
        taken = time.perf_counter() - began
    began = time.perf_counter()
    mujoco_motion(mj, ctrls)
    mujoco_taken = time.perf_counter() - began
    theirs, noisy = (mujoco_motion(converged(mj), ctrls, x) for x in ("", precision))
    here, there, near = (Measured(mj, *x) for x in (ours, theirs, noisy))
    change = np.ptp(there.energy)
    return {
        "precision": precision,
        "seconds": len(ctrls) * mj.opt.timestep,
        "finite": bool(status.finite and np.isfinite(ours[0]).all()),
        "lost": int(status.contact_overflow),
        "deepest": here.deepest,
        "MuJoCo": there.deepest,
        "apart": here.apart(there),
        "noise": near.apart(there),
        "energy": np.abs(here.energy - there.energy).max() / change,
        "noise energy": np.abs(near.energy - there.energy).max() / change,
        "ms": 1e3 * taken / len(ctrls),
        "MuJoCo ms": 1e3 * mujoco_taken / len(ctrls),
        "compile s": seconds,
    }


def converged(mj: mujoco.MjModel) -> mujoco.MjModel:
    """The same model, whose solvers and search for contacts go on to the end."""
    exact = copy.copy(mj)
    common.converge(exact)
    return exact


def noisy_step(mj: mujoco.MjModel, data: mujoco.MjData, precision: str) -> None:
    """A step, after which the state is rounded to a precision."""
    mujoco.mj_step(mj, data)
    for part in (data.qpos, data.qvel):
        part[:] = part.astype(precision or float)


def mujoco_motion(mj: mujoco.MjModel, ctrls: np.ndarray, noisy: str = ""):
    """Positions (T, nq) and velocities (T, nv) after each step, with the noise of a precision."""
    data = models.start(mj)
    along = np.random.default_rng(0).normal(size=mj.nv)
    mujoco.mj_integratePos(mj, data.qpos, along, NOISE.get(noisy, 0))
    motion = []
    for ctrl in ctrls:
        data.ctrl[:] = ctrl
        noisy_step(mj, data, noisy)
        motion.append((data.qpos.copy(), data.qvel.copy()))
    return [np.stack(x) for x in zip(*motion, strict=True)]


class Measured:
    """What MuJoCo C measures of a motion.

    Attributes:
      energy: kinetic and potential energies along it (J).
      deepest: deepest penetration at its end (m).
      places: positions of all bodies there (m).
    """

    def __init__(self, mj: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray):
        data, energy = mujoco.MjData(mj), []
        for data.qpos[:], data.qvel[:] in zip(qpos[::-SAMPLED], qvel[::-SAMPLED], strict=True):
            mujoco.mj_fwdPosition(mj, data)
            mujoco.mj_energyPos(mj, data)
            mujoco.mj_energyVel(mj, data)
            energy.append(data.energy.sum())
        self.energy = np.array(energy[::-1])
        data.qpos[:] = qpos[-1]
        mujoco.mj_fwdPosition(mj, data)
        self.deepest = -min(data.contact.dist, default=0.0)
        self.places = data.xpos.copy()

    def apart(self, other: "Measured") -> float:
        """The largest distance of a body of two motions at their ends (m)."""
        return np.linalg.norm(self.places - other.places, axis=1).max()


def support_model(names: tuple[str, str]) -> mujoco.MjModel:
    """A fixed geom, and a body of 1 kg above it that weak springs hold upright and in place."""
    heights = np.random.default_rng(1).random(25)
    sizes = {"plane": 'size="0 0 1"', "hfield": 'hfield="hfield"'}
    below, above = (
        f'<geom type="{n}" {sizes[n] if n in sizes else _size(n)} mass="1"/>' for n in names
    )
    slides = "".join(
        f'<joint type="slide" axis="{axis}" stiffness="{k}" damping="8"/>'
        for axis, k in (("1 0 0", 40), ("0 1 0", 40), ("0 0 1", 2))
    )
    return mujoco.MjModel.from_xml_string(
        f"""<mujoco><asset>{_hull()}
        <hfield name="hfield" nrow="5" ncol="5" size=".6 .6 .1 .1"
          elevation="{" ".join(f"{x:.3f}" for x in heights)}"/></asset>
        <worldbody><body name="below">{below}</body><body name="above">{slides}
          <joint type="ball" stiffness="1" damping=".1"/>{above}
          <inertial pos="0 0 0" mass="1" diaginertia=".01 .01 .01"/></body></worldbody></mujoco>"""
    )


def support(names: tuple[str, str], poses: int, precision: str) -> dict:
    """The row of a pair."""
    import jax
    import jax.numpy as jnp

    import jaxsim

    mj, rng = support_model(names), np.random.default_rng(0)
    qpos = np.concatenate([0.02 * rng.normal(size=(poses, 3)), rng.normal(size=(poses, 4))], axis=1)
    qpos[:, 3:] /= np.linalg.norm(qpos[:, 3:], axis=1, keepdims=True)
    qpos[:, 2] += 0.3 if names[0] != "plane" else 0.2
    length = round(1 / mj.opt.timestep)

    def rest(start):
        model = jaxsim.load(mj)
        state = jaxsim.make_state(model).replace(qpos=start)
        end, _ = jaxsim.rollout(model, state, jnp.zeros((length, 0), start.dtype))
        return end.qpos, jaxsim.forward(model, end).qfrc_constraint

    with jax.enable_x64(precision == "float64"):
        quick = jax.jit(jaxsim.vmap(rest), compiler_options=common.quick_options(0))
        ours = [np.asarray(x, float) for x in quick(jnp.asarray(qpos, precision))]
    theirs, noisy = (mujoco_rest(converged(mj), qpos, length, x) for x in ("", precision))
    found, noise = (_differences(x, theirs) for x in (ours, noisy))
    row = {"pair": "-".join(names), "precision": precision} | found
    return row | {f"noise {key}": value for key, value in noise.items()}


def mujoco_rest(mj: mujoco.MjModel, qpos: np.ndarray, length: int, noisy: str):
    """Positions (n, 7) after so many steps, and the constraint's forces (n, 6) there."""
    ends = []
    for start in qpos:
        data = mujoco.MjData(mj)
        data.qpos[:] = start + NOISE.get(noisy, 0) * np.arange(1, 8)
        for _ in range(length):
            noisy_step(mj, data, noisy)
        mujoco.mj_forward(mj, data)
        ends.append((data.qpos.copy(), data.qfrc_constraint.copy()))
    return [np.stack(x) for x in zip(*ends, strict=True)]


def _differences(ours, theirs) -> dict[str, float]:
    """Largest differences of forces, torques, positions and turns."""
    (pos, force), (pos_there, force_there) = ours, theirs
    change = np.abs(force - force_there) / WEIGHT
    cosine = np.sum(pos[:, 3:] * pos_there[:, 3:], axis=1)
    turn = 2 * np.linalg.norm(pos[:, 3:] - np.sign(cosine)[:, None] * pos_there[:, 3:], axis=1)
    return {
        "force": change[:, :3].max(),
        "torque": change[:, 3:].max() / 0.1,
        "pos": np.abs(pos - pos_there)[:, :3].max(),
        "turn": turn.max(),
    }


if __name__ == "__main__":
    main()
