"""The models of the benchmarks, and states that they visit.

Most are shipped by other packages. Those of MuJoCo Menagerie are read from a folder that holds a
copy of it (github.com/google-deepmind/mujoco_menagerie).
"""

import argparse
import dataclasses
import importlib.util
import pathlib

import mujoco
import numpy as np

MODELS = {
    "humanoid": ("mujoco", "mjx/test_data/humanoid/humanoid.xml"),
    "ant": ("gymnasium", "envs/mujoco/assets/ant.xml"),
    "half_cheetah": ("gymnasium", "envs/mujoco/assets/half_cheetah.xml"),
    "hopper": ("gymnasium", "envs/mujoco/assets/hopper.xml"),
    "walker2d": ("gymnasium", "envs/mujoco/assets/walker2d_v5.xml"),
    "double_pendulum": ("gymnasium", "envs/mujoco/assets/inverted_double_pendulum.xml"),
    "barkour": ("mujoco", "mjx/test_data/barkour_v0/assets/barkour_v0_mjx.xml"),
    "shadow_hand": ("mujoco", "mjx/test_data/shadow_hand/scene_right.xml"),
    "gymnasium_humanoid": ("gymnasium", "envs/mujoco/assets/humanoid.xml"),
    "five_humanoids": ("mujoco", "mjx/test_data/humanoid/05_humanoids.xml"),
}
# Files of Menagerie.
MENAGERIE = {
    "go1": "unitree_go1/scene.xml",
    "go2": "unitree_go2/scene.xml",
    "panda_box": "franka_emika_panda/scene.xml",
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of the benchmarks that step a batch of visited states on one thread."""
    add_models(parser, ["humanoid", "ant", "half_cheetah", "hopper", "walker2d"])
    parser.add_argument("--batch", type=int, default=128, help="environments")
    parser.add_argument("--states", type=int, default=32, help="different states in the batch")


def add_models(parser: argparse.ArgumentParser, usual: list[str]) -> None:
    """Options that choose models of both tables."""
    parser.add_argument("--models", nargs="*", default=usual, choices=[*MODELS, *MENAGERIE])
    parser.add_argument("--menagerie", type=pathlib.Path, help="folder of MuJoCo Menagerie")


def load(name: str, menagerie: pathlib.Path | None = None) -> mujoco.MjModel:
    """A model of the tables, with the Euler integrator and its other settings as shipped.

    Args:
      name: its name.
      menagerie: folder of MuJoCo Menagerie.

    Raises:
      FileNotFoundError: its file is not there.
    """
    spec = mujoco.MjSpec.from_file(str(_file(name, menagerie)))
    if name == "panda_box":
        add_box(spec)
    mj = spec.compile()
    mj.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
    return mj


def _file(name: str, menagerie: pathlib.Path | None) -> pathlib.Path:
    if name in MENAGERIE:
        if menagerie is None:
            raise FileNotFoundError(f"model {name} is in MuJoCo Menagerie: give --menagerie FOLDER")
        path = menagerie / MENAGERIE[name]
        if not path.exists():
            raise FileNotFoundError(f"model {name}: there is no file {path}")
        return path
    package, path = MODELS[name]
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None:
        raise FileNotFoundError(f"model {name} is shipped by {package}, which is not installed")
    return pathlib.Path(found.origin).parent / path


def add_box(spec: mujoco.MjSpec, half: float = 0.02) -> None:
    """A free box on the floor in front of an arm, also in its keyframes."""
    pose = [0.5, 0, half, 1, 0, 0, 0]
    body = spec.worldbody.add_body(name="box", pos=pose[:3])
    body.add_freejoint()
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[half] * 3, mass=0.1)
    for key in spec.keys:
        key.qpos = [*key.qpos, *pose]


@dataclasses.dataclass
class States:
    """States along a rollout of MuJoCo C, with what it computes there; leading axis counts them."""

    qpos: np.ndarray
    qvel: np.ndarray
    act: np.ndarray
    warmstart: np.ndarray
    ctrl: np.ndarray
    qacc: np.ndarray
    contacts: np.ndarray
    iterations: np.ndarray

    def batch(self, model, lanes: int):
        """`lanes` states and controls of jaxsim, repeated from the start where there are fewer."""
        import jax.numpy as jnp

        import jaxsim

        index = np.arange(lanes) % len(self.qpos)
        state = repeated(jaxsim.make_state(model), lanes)
        as_float = lambda x: jnp.asarray(x[index], state.qpos.dtype)  # noqa: E731
        state = state.replace(
            qpos=as_float(self.qpos),
            qvel=as_float(self.qvel),
            act=as_float(self.act),
            qacc_warmstart=as_float(self.warmstart),
        )
        return state, as_float(self.ctrl)


def repeated(tree, lanes: int):
    """A tree of arrays, with a leading axis of so many copies."""
    import jax
    import jax.numpy as jnp

    return jax.tree.map(lambda x: jnp.broadcast_to(x, (lanes, *jnp.shape(x))), tree)


def visited(mj: mujoco.MjModel, count: int, seed: int = 0) -> States:
    """States at equal distances along a second of random controls, from the first keyframe."""
    rng, data = np.random.default_rng(seed), start(mj)
    data.qvel[:] += 0.01 * rng.standard_normal(mj.nv)
    every = max(1, round(1 / (mj.opt.timestep * count)))
    records = []
    for _ in range(count):
        for _ in range(every):
            data.ctrl[:] = controls(mj, rng, ())
            mujoco.mj_step(mj, data)
        records.append(observe(mj, data))
    return _stacked(records)


def at_start(mj: mujoco.MjModel, count: int, seed: int = 0) -> States:
    """The start with different small velocities; unlike a rollout it keeps all contacts."""
    rng, records = np.random.default_rng(seed), []
    for _ in range(count):
        data = start(mj)
        data.qvel[:] = 0.01 * rng.standard_normal(mj.nv)
        records.append(observe(mj, data))
    return _stacked(records)


def _stacked(records: list[tuple]) -> States:
    return States(*(np.stack(column) for column in zip(*records, strict=True)))


def start(mj: mujoco.MjModel) -> mujoco.MjData:
    """Data at the first keyframe, or at qpos0 without one."""
    data = mujoco.MjData(mj)
    if mj.nkey:
        mujoco.mj_resetDataKeyframe(mj, data, 0)
    return data


def observe(mj: mujoco.MjModel, data: mujoco.MjData) -> tuple:
    """What `States` holds of a moment."""
    warmstart = data.qacc_warmstart.copy()
    mujoco.mj_forward(mj, data)
    found = (data.qacc.copy(), data.ncon, int(data.solver_niter.sum()))
    data.qacc_warmstart[:] = warmstart
    state = (data.qpos.copy(), data.qvel.copy(), data.act.copy(), warmstart, data.ctrl.copy())
    return state + found


def controls(mj: mujoco.MjModel, rng: np.random.Generator, shape: tuple) -> np.ndarray:
    """Random controls in the middle half of their ranges."""
    limited = mj.actuator_ctrllimited.astype(bool)
    low = np.where(limited, mj.actuator_ctrlrange[:, 0], -1.0)
    high = np.where(limited, mj.actuator_ctrlrange[:, 1], 1.0)
    return (low + high) / 2 + (high - low) / 4 * rng.uniform(-1, 1, (*shape, mj.nu))


def acceleration_error(actual: np.ndarray, expected: np.ndarray) -> dict[str, float]:
    """Largest difference in each state relative to its largest acceleration: worst and median."""
    scale = np.maximum(np.abs(expected).max(1), 1.0)
    error = np.abs(np.asarray(actual, float) - expected).max(1) / scale
    return {"qacc error": float(error.max()), "median error": float(np.median(error))}
