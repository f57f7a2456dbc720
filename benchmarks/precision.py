"""Random scenes on all scales, float32 beside float64 and MuJoCo C.

Bodies on a plane, and piles of three. Drawn at random: friction (1e-5 to 10), slenderness (to
1:1000), masses (ratios to 1e4), impratio (1 to 100), the time constant of contacts (2 to 20
timesteps), the tilt of gravity (half of the scenes), a pose in slight contact and a velocity. A row
tells of one family of scenes and one precision:

- `not finite` and `through`: scenes that end there, or below the floor, where MuJoCo C's are not at
  any time (contacts are soft: the middle of a wire or a sheet may dip by its thickness);
- `chaotic`: scenes that do so, but where MuJoCo C's do, too, when every velocity of every step is
  changed by rounding; the former do not count them;
- `qacc error`: largest difference of the first acceleration to that of MuJoCo C, both with a
  tolerance of zero, relative to the largest acceleration or 1; the median, 99 of 100, the worst;
- `not converged`: scenes where the status of that solve says so;
- `at rest`: scenes that MuJoCo C brings to rest, and the largest difference of heights there (m).
  Two rests may be two poses, as of a body that stands or lies: `other pose` counts differences of
  more than a tenth of the body's size, which are left out.

The same columns for MuJoCo C with its own tolerance say what its solver leaves. `failed` in the
result has the numbers of the scenes in the first three columns; `--only` simulates some by number.
"""

import argparse
import dataclasses

import common
import mujoco
import numpy as np

SHAPES = ("box", "capsule", "cylinder", "sphere")
FAMILIES = tuple(f"{s} {c}" for s in (*SHAPES, "pile") for c in ("pyramidal", "elliptic"))
TIMESTEP = 0.002
# Motions of a scene by MuJoCo C with rounding added, and its size beside the largest change.
NEIGHBOURS, ROUNDING = 32, 1e-7
QUICK = {"xla_backend_optimization_level": 0}

XML = """
<mujoco>
  <option timestep="{timestep}" cone="{cone}" impratio="{impratio}" gravity="{gx} {gy} -9.81"/>
  <default>
    <geom friction="{friction} {spin} {roll}" solref="{solref} 1" condim="{condim}"/>
  </default>
  <worldbody><geom type="plane" size="0 0 1" friction="0 0 0"/>{bodies}</worldbody>
</mujoco>
"""
BODY = """
<body pos="{x} 0 {z}" euler="{turn} 0 {heading}"><freejoint/>
  <geom type="{shape}" size="{size}" mass="{mass}"/></body>
"""


@dataclasses.dataclass
class Scene:
    """A model and where it starts, with the size of its smallest body (m)."""

    mj: mujoco.MjModel
    qvel: np.ndarray
    size: float


@dataclasses.dataclass
class Outcome:
    """First accelerations and last states of scenes; leading axis counts them."""

    qacc: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    converged: np.ndarray
    dipped: np.ndarray | None = None  # whether a body was below the floor at any time, if known


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup()
    rows, failed = [], {}
    for family in options.families:
        new, failed[family] = _rows(family, options)
        rows += new
        print(common.table(new), failed[family], flush=True)
    common.write(options, __file__, {"rows": rows, "failed": failed})


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__ or "", repetitions=1)
    parser.add_argument("--scenes", type=int, default=10_000, help="of all families together")
    parser.add_argument("--families", nargs="+", default=list(FAMILIES), choices=FAMILIES)
    parser.add_argument("--steps", type=int, default=500, help="timesteps of each scene")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", type=int, nargs="+", help="numbers of scenes of each family")
    return parser.parse_args(arguments)


def _rows(family: str, options) -> tuple[list[dict], dict[str, list[int]]]:
    """The rows of a family, and the numbers of the scenes that failed in each."""
    rng = np.random.default_rng([options.seed, FAMILIES.index(family)])
    count = -(-options.scenes // len(options.families))
    scenes = [draw(rng, *family.split()) for _ in range(count)]
    numbers = np.array(range(count) if options.only is None else options.only)
    scenes = [scenes[i] for i in numbers]
    exact = mujoco_outcome(scenes, options.steps, converged=True)
    found = {
        "float32": jaxsim_outcome(scenes, options.steps, x64=False),
        "float64": jaxsim_outcome(scenes, options.steps, x64=True),
        "MuJoCo C": mujoco_outcome(scenes, options.steps, converged=False),
    }
    start = {"scenes of": family, "scenes": len(scenes)}
    rows = [
        start | {"by": by} | compare(scenes, one, exact, options.steps) for by, one in found.items()
    ]
    return rows, {
        by: numbers[np.any(failures(one, exact), 0)].tolist() for by, one in found.items()
    }


def draw(rng: np.random.Generator, shape: str, cone: str) -> Scene:
    """One scene of a family."""
    log = lambda low, high: 10 ** rng.uniform(low, high)  # noqa: E731
    shapes = ("box", "sphere", "sphere") if shape == "pile" else (shape,)
    slender = 1 if shape == "pile" else 3
    bodies, top, sizes = "", 0.0, []
    for i, kind in enumerate(shapes):
        size, height = _size(rng, kind, slender)
        sizes.append(size[-1] if kind == "box" else size[0])
        bodies += BODY.format(
            x=0.1 * min(sizes) * i,
            z=top + height * (1 - log(-4, -2)),
            turn=90 if kind in ("capsule", "cylinder") else 0,
            heading=rng.uniform(-180, 180) if len(shapes) == 1 else 0,
            shape=kind,
            size=" ".join(map(str, size)),
            mass=log(-2, 2) if len(shapes) > 1 else log(-1, 1),
        )
        top += 2 * height
    friction, tilt = log(-5, 1), rng.uniform(-2, 2, 2) * rng.integers(2)
    text = XML.format(
        timestep=TIMESTEP,
        cone=cone,
        impratio=log(0, 2),
        gx=tilt[0],
        gy=tilt[1],
        friction=friction,
        spin=5e-3 * friction,
        roll=1e-4 * friction,
        solref=2 * TIMESTEP * log(0, 1),
        condim=6 if shape == "sphere" else 3,
        bodies=bodies,
    )
    mj = mujoco.MjModel.from_xml_string(text)
    return Scene(mj, rng.normal(size=mj.nv) * log(-4, -0.5), min(sizes))


def _size(rng: np.random.Generator, kind: str, slender: float) -> tuple[list[float], float]:
    """Sizes of a geom, and half its height where it lies."""
    length = 10 ** rng.uniform(-1.3, 0)
    thin = length / 10 ** rng.uniform(0, slender)
    if kind == "box":  # a rod or a plate
        return [length, rng.choice([thin, length]), thin], thin
    return ([length], length) if kind == "sphere" else ([thin, length], thin)


def mujoco_outcome(scenes: list[Scene], steps: int, converged: bool) -> Outcome:
    """By MuJoCo C; if `converged`, its solver goes on to its limits at the first instant."""
    records = []
    for scene in scenes:
        data = mujoco.MjData(scene.mj)
        data.qvel[:] = scene.qvel
        tolerance = scene.mj.opt.tolerance
        if converged:
            scene.mj.opt.tolerance = 0
        mujoco.mj_forward(scene.mj, data)
        scene.mj.opt.tolerance = tolerance
        qacc, dipped = data.qacc.copy(), False
        for _ in range(steps):
            mujoco.mj_step(scene.mj, data)
            dipped |= bool(_below(data.qpos[None])[0])
        stable = not data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number
        qpos = data.qpos.copy() if stable else np.nan * data.qpos
        records.append((qacc, qpos, data.qvel.copy(), True, dipped))
    return Outcome(*map(np.array, zip(*records, strict=True)))


def jaxsim_outcome(scenes: list[Scene], steps: int, x64: bool) -> Outcome:
    """The same by jaxsim, all scenes as one batch."""
    import jax
    import jax.numpy as jnp

    import jaxsim

    def run(model, qvel):
        state = jaxsim.make_state(model).replace(qvel=qvel)
        exact = model.replace(opt=model.opt.replace(tolerance=jnp.zeros_like(model.opt.tolerance)))
        first = jaxsim.forward(exact, state)
        step = lambda state, _: (jaxsim.step(model, state), None)  # noqa: E731
        last, _ = jax.lax.scan(step, state, None, length=steps)
        return first.qacc, last.qpos, last.qvel, first.status.converged

    with jax.enable_x64(x64):
        models = [jaxsim.load(scene.mj) for scene in scenes]
        model = jax.tree.map(lambda *leaves: jnp.stack(leaves), *models)
        qvel = jnp.asarray(np.stack([scene.qvel for scene in scenes]), model.qpos0.dtype)
        found = jax.jit(jaxsim.vmap(run), compiler_options=QUICK)(model, qvel)
        return Outcome(*map(np.asarray, found))


def neighbours(scene: Scene, steps: int) -> np.ndarray:
    """Last positions of motions by MuJoCo C that rounding drives apart."""
    rng, ends = np.random.default_rng(0), []
    for _ in range(NEIGHBOURS):
        data = mujoco.MjData(scene.mj)
        data.qvel[:] = scene.qvel
        for _ in range(steps):
            mujoco.mj_step(scene.mj, data)
            change = TIMESTEP * np.abs(data.qacc).max()
            data.qvel[:] += ROUNDING * change * rng.normal(size=scene.mj.nv)
        stable = not data.warning[mujoco.mjtWarning.mjWARN_BADQACC].number
        ends.append(data.qpos if stable else np.nan * data.qpos)
    return np.array(ends)


def _below(qpos: np.ndarray) -> np.ndarray:
    """Whether any body of a scene is below the floor."""
    return (qpos[:, 2::7] < 0).any(1)


def failures(found: Outcome, exact: Outcome) -> tuple[np.ndarray, np.ndarray]:
    """Scenes that end not finite, and those below the floor, where the exact ones do not."""
    sound, finite = (np.isfinite(x.qpos).all(1) for x in (exact, found))
    return sound & ~finite, finite & sound & _below(found.qpos) & ~exact.dipped


def compare(scenes: list[Scene], found: Outcome, exact: Outcome, steps: int) -> dict:
    """What a row says of one precision."""
    sound = np.isfinite(exact.qpos).all(1)
    size = np.array([scene.size for scene in scenes])
    heights, theirs = found.qpos[:, 2::7], exact.qpos[:, 2::7]
    broken, through = failures(found, exact)
    chaotic = np.zeros(len(scenes), bool)
    for i in np.flatnonzero(broken | through):
        near = neighbours(scenes[i], steps)
        chaotic[i] = (_below(near) if through[i] else ~np.isfinite(near).all(1)).any()
    scale = np.maximum(np.abs(exact.qacc).max(1), 1)
    error = np.nan_to_num(np.abs(found.qacc - exact.qacc).max(1) / scale, nan=np.inf)
    rests = sound & (np.abs(exact.qvel).max(1) < 1e-3) & (heights > 0).all(1)
    apart = np.abs(heights - theirs).max(1, initial=0)
    other = rests & (apart > 0.1 * size)
    return {
        "not finite": int((broken & ~chaotic).sum()),
        "through": int((through & ~chaotic).sum()),
        "chaotic": int(chaotic.sum()),
        "qacc error, median": float(np.median(error)),
        "99 %": float(np.quantile(error, 0.99, method="lower")),
        "worst": float(error.max()),
        "not converged": int((~found.converged).sum()),
        "at rest": int(rests.sum()),
        "other pose": int(other.sum()),
        "rest error": float(apart[rests & ~other].max(initial=0)),
    }


if __name__ == "__main__":
    main()
