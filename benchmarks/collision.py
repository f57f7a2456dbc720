"""Contacts of every pair of shapes beside MuJoCo C: errors, float32, gradients, time.

Two geoms are turned at random, and one is moved along a random line until they are near (0.1 to
10 mm), touching (within 0.01 mm), deep in each other (4 to 60 mm) or far apart (5 cm to 1 m). A
row tells of one pair:

- `near`, `touching`, `deep`, `far`: the largest error of the smallest signed distance (m), and
  `99.9 %` the one that one pose in a thousand exceeds. Pairs of flat faces and pairs with a closed
  form are compared with MuJoCo C, whose rules they follow; the others with the largest separation
  over all directions (`collision_truth.py`), as is MuJoCo C in `MuJoCo near` and so on;
- `float32`: the largest difference to float64, near and touching, and at axes that are parallel or
  at right angles up to a small tilt (`aligned`), with the poses rounded first;
- `contacts`: the share of near, touching and deep poses with as many contacts as MuJoCo C;
- `gradient`: the largest error of derivatives of the smallest distance along random motions,
  against central differences in float64, where that is smooth; `not finite` counts aligned poses
  whose derivatives are not finite;
- `us`, `MuJoCo us`: processor time of a pose, ours in float32 in a batch of 1,024 on one core.

Times need a quiet machine, the rest does not: `--times-of results/collision.json` measures only
times anew, and keeps everything else of that record. The record is written after each pair; with
`--keep` it also has the rows of another record.
"""

import argparse
import json
import pathlib

import collision_poses
import common
import mujoco
import numpy as np
from collision_truth import signed_distances

BATCH = 1024
# Pairs whose contacts follow rules of MuJoCo that are not the largest separation.
RULES = {
    ("capsule", "capsule"),
    ("capsule", "box"),
    *((a, b) for a in ("capsule", "cylinder") for b in ("cylinder", "mesh")),
    ("cylinder", "box"),
    ("box", "box"),
    ("box", "mesh"),
    ("mesh", "mesh"),
    *(("hfield", b) for b in collision_poses.SHAPES[2:]),
}
STEP = 1e-6
NAMES = ["-".join(p) for p in collision_poses.PAIRS]


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup()
    if options.times_of:
        common.write(options, __file__, {"rows": timed_again(options)})
        return
    kept = json.loads(options.keep.read_text())["rows"] if options.keep else []
    rows = {row["pair"]: row for row in kept}
    for pair in options.pairs:
        rows[pair] = measure(tuple(pair.split("-")), options)
        print(common.table([rows[pair]]), flush=True)
        common.write(options, __file__, {"rows": [rows[p] for p in NAMES if p in rows]})


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__ or "", repetitions=5)
    parser.add_argument("--pairs", nargs="+", default=NAMES, choices=NAMES)
    parser.add_argument("--poses", type=int, default=10_000, help="of each pair, in four parts")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--keep", type=pathlib.Path, help="a record with rows of other pairs")
    parser.add_argument("--times-of", type=pathlib.Path, help="a record whose times are replaced")
    return parser.parse_args(arguments)


def measure(names: tuple[str, str], options) -> dict:
    """One row."""
    rng = np.random.default_rng([options.seed, collision_poses.PAIRS.index(names)])
    pair = Pair(names)
    count = max(options.poses // 4, 1)
    row: dict = {"pair": "-".join(names)}
    poses, same = {}, []
    for regime, (low, high) in collision_poses.REGIMES.items():
        start = collision_poses.random_poses(names, rng, count)
        target = rng.uniform(low, high, count)
        poses[regime] = collision_poses.move_to(target, start, pair.contacts)
        errors, equal = pair.errors(regime, *poses[regime])
        same += [equal] * (regime != "far")
        row |= errors
    aligned = collision_poses.aligned_poses(names, rng, min(count, BATCH))
    aligned = collision_poses.move_to(np.zeros(len(aligned[0])), aligned, pair.contacts)
    row["float32"] = max(pair.float32_error(*poses[r]) for r in ("near", "touching"))
    row["aligned"] = pair.float32_error(*aligned)
    row["contacts"] = float(np.mean(same))
    row |= pair.gradient_errors(rng, poses["near"], aligned)
    return row | pair.times(poses["touching"], options)


def timed_again(options) -> list[dict]:
    """The rows of a record with new times."""
    rows = json.loads(options.times_of.read_text())["rows"]
    for row in rows:
        names = tuple(row["pair"].split("-"))
        rng = np.random.default_rng(options.seed)
        start, target = collision_poses.random_poses(names, rng, BATCH), np.zeros(BATCH)
        pair = Pair(names)
        row |= pair.times(collision_poses.move_to(target, start, pair.contacts), options)
    return rows


class Pair:
    """Both engines' contacts of two geoms, for arrays of poses."""

    def __init__(self, names: tuple[str, str]):
        self.rules = names in RULES
        self.general = not self.rules and names[0] not in ("plane", "hfield")
        self.mj = collision_poses.model(names, collision_poses.MARGIN)
        self.far = collision_poses.model(names, collision_poses.FAR_MARGIN)
        self._programs: dict = {}

    def contacts(self, pos, mat, dtype: type = np.float64):
        """Distances (n, k) and normals (n, k, 3)."""
        import jax

        with jax.enable_x64(True):
            program = self._program("contacts", dtype)
            return [np.asarray(x, float) for x in _batched(program, pos, mat, dtype)]

    def _program(self, kind: str, dtype):
        import jax

        if (kind, dtype) not in self._programs:
            f = getattr(self, f"_{kind}")
            shapes = [(BATCH, 2, 3), (BATCH, 2, 3, 3)]
            arguments = [jax.ShapeDtypeStruct(s, dtype) for s in shapes]
            jitted = jax.jit(_vmapped(f), compiler_options=common.quick_options(0))
            self._programs[kind, dtype] = jitted.lower(*arguments).compile()
        return self._programs[kind, dtype]

    def _detect(self, pos, mat):
        import jaxsim
        from jaxsim.collision import detect, model_candidates

        model = jaxsim.load(self.mj)
        return detect(model, model_candidates(model), pos, mat)

    def _contacts(self, pos, mat):
        found = self._detect(pos, mat)
        return found.dist, found.frame[:, 0]

    def _gradient(self, pos, mat):
        import jax
        import jax.numpy as jnp

        return jax.grad(lambda *x: jnp.min(self._detect(*x).dist), argnums=(0, 1))(pos, mat)

    def errors(self, regime: str, pos, mat):
        """Errors at poses, and of each whether it has as many contacts as MuJoCo C."""
        dist, _ = self.contacts(pos, mat)
        far = regime == "far"
        theirs, count = mujoco_contacts(self.far if far else self.mj, pos, mat)
        ours = dist.min(axis=1)
        found = {}
        if self.rules:
            there = np.isfinite(theirs)
            reference = np.where(there, theirs, ours)
        else:
            reference = signed_distances(self.mj, pos, mat)
            error = np.abs(theirs - reference)
            found[f"MuJoCo {regime}"] = np.max(error[np.isfinite(error)], initial=0)
        error = np.abs(ours - reference)
        found |= {regime: error.max(), f"{regime} 99.9 %": np.quantile(error, 0.999)}
        limit = (self.far if far else self.mj).pair_margin[0]
        return found, np.sum(dist < limit, axis=1) == count

    def float32_error(self, pos, mat) -> float:
        """Largest difference of the smallest distances in float32 and float64."""
        pos, mat = pos.astype(np.float32), mat.astype(np.float32)
        exact = self.contacts(pos.astype(float), mat.astype(float))[0].min(axis=1)
        return np.abs(self.contacts(pos, mat, np.float32)[0].min(axis=1) - exact).max()

    def gradient_errors(self, rng, poses, aligned: tuple[np.ndarray, np.ndarray]) -> dict:
        """Derivatives along random motions of the second geom, against central differences."""
        import jax

        pos, mat = (x[:BATCH] for x in poses)
        shift, spin = (rng.normal(size=(len(pos), 3)) for _ in range(2))
        skew = np.cross(spin[:, None], np.eye(3)).swapaxes(1, 2)

        def at(h):
            moved, turned = pos.copy(), mat.copy()
            moved[:, 1] += h * shift
            turned[:, 1] = (np.eye(3) + h * skew + h * h / 2 * skew @ skew) @ mat[:, 1]
            return self.contacts(moved, turned)[0].min(axis=1)

        with jax.enable_x64(True):
            program = self._program("gradient", np.float64)
            by_pos, by_mat = _batched(program, pos, mat, np.float64)
            finite = [
                np.isfinite(x).reshape(len(x), -1).all(axis=1)
                for x in _batched(program, *aligned, np.float64)
            ]
        ours = np.sum(by_pos[:, 1] * shift, axis=1)
        ours += np.sum(by_mat[:, 1] * (skew @ mat[:, 1]), axis=(1, 2))
        minus, middle, plus = (at(h) for h in (-STEP, 0.0, STEP))
        smooth = np.abs(plus - 2 * middle + minus) < 1e-9
        error = np.abs(ours - (plus - minus) / (2 * STEP))[smooth]
        return {
            "gradient": error.max(initial=0),
            "gradient 99 %": np.quantile(error, 0.99) if len(error) else None,
            "smooth": smooth.mean(),
            "not finite": int(np.sum(~finite[0] | ~finite[1])),
        }

    def times(self, poses, options) -> dict:
        """Microseconds of a pose for both, and seconds to compile ours."""
        single = [np.resize(x.astype(np.float32), (BATCH, *x.shape[1:])) for x in poses]
        run, _, seconds = common.compile_for(_vmapped(self._contacts), *single)
        pair = {
            "us": run,
            "MuJoCo us": lambda: mujoco_contacts(self.mj, *(x[:64] for x in poses)),
        }
        timings = common.interleave(pair, options.repetitions, clock=options.clock)
        per = {"us": BATCH, "MuJoCo us": min(64, len(poses[0]))}
        times = {k: 1e6 * t.per(per[k]).median for k, t in timings.items()}
        return times | {"compile s": seconds}


def _vmapped(f):
    import jaxsim

    return jaxsim.vmap(f)


def _batched(program, pos, mat, dtype):
    """Results of a program for BATCH poses at a time."""
    parts = []
    for start in range(0, len(pos), BATCH):
        part = [x[start : start + BATCH].astype(dtype) for x in (pos, mat)]
        count = len(part[0])
        padded = [np.concatenate([x, np.repeat(x[:1], BATCH - count, axis=0)]) for x in part]
        parts.append([np.asarray(x)[:count] for x in program(*padded)])
    return [np.concatenate(x) for x in zip(*parts, strict=True)]


def mujoco_contacts(mj: mujoco.MjModel, pos, mat):
    """Smallest distances of MuJoCo C, not a number without contacts, and numbers of contacts."""
    data = mujoco.MjData(mj)
    mujoco.mj_forward(mj, data)
    dist, count = np.full(len(pos), np.nan), np.zeros(len(pos), int)
    for i, (x, r) in enumerate(zip(pos, mat.reshape(len(mat), 2, 9), strict=True)):
        data.geom_xpos[:], data.geom_xmat[:] = x, r
        mujoco.mj_collision(mj, data)
        count[i] = data.ncon
        if data.ncon:
            dist[i] = data.contact.dist.min()
    return dist, count


if __name__ == "__main__":
    main()
