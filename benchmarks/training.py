"""Returns of trained policies against wall time and environment steps.

Every training runs in a fresh process without a compilation cache, so that its seconds include
everything from the start of Python to the last evaluation. The return is the mean over the
episodes of an evaluation with the deterministic policy; the table has medians over the seeds.
The trained policy also plays Gymnasium's own task, in MuJoCo C.

examples:
  python benchmarks/training.py                                  the whole table, some hours
  python benchmarks/training.py --envs hopper ant --seeds 0
  python benchmarks/training.py --envs cartpole hopper ant --algorithms shac ppo

Results accumulate in the file: a run replaces the earlier one of the same environment, algorithm
and seed.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import sys
import tempfile
import time

import common

# Return to reach, and the minutes to reach it in, on two cores.
GOALS = {
    "inverted_pendulum": (950, 0.75),
    "reacher": (-5, 3),
    "inverted_double_pendulum": (9000, 4),
    "cartpole": (800, 2),
    "swimmer": (120, 5),
    "hopper": (2200, 10),
    "half_cheetah": (4000, 12),
    "walker2d": (2500, 15),
    "ant": (3000, 30),
}
USUAL = {"cartpole": "shac"}  # everything else by PPO
GYMNASIUM = {
    "inverted_pendulum": "InvertedPendulum-v5",
    "reacher": "Reacher-v5",
    "inverted_double_pendulum": "InvertedDoublePendulum-v5",
    "swimmer": "Swimmer-v5",
    "hopper": "Hopper-v5",
    "half_cheetah": "HalfCheetah-v5",
    "walker2d": "Walker2d-v5",
    "ant": "Ant-v5",
    "humanoid": "Humanoid-v5",
}
COLUMNS = ("env", "algorithm", "seeds", "goal", "within", "reached", "return", "in MuJoCo C")
COLUMNS += ("minutes", "steps", "steps/s")


def main() -> None:
    options = _options()
    if options.worker:
        return work(options)
    runs = _earlier(options)
    for env in options.envs:
        for algorithm in options.algorithms or [USUAL.get(env, "ppo")]:
            for seed in options.seeds:
                run = measure(options, env, algorithm, seed)
                runs = [r for r in runs if _key(r) != _key(run)] + [run]
                runs.sort(key=lambda r: [str(k) for k in _key(r)])
                rows = summary(runs)
                common.write(options, __file__, {"table": rows, "runs": runs})
                _draw(options, env, [r for r in runs if r["env"] == env])
    print(common.table(summary(runs), COLUMNS))
    return None


def measure(options: argparse.Namespace, env: str, algorithm: str, seed: int) -> dict:
    """Train in a process of its own; its wall time is ours."""
    with tempfile.TemporaryDirectory() as folder:
        result = pathlib.Path(folder) / "run.json"
        command = [sys.executable, __file__, "--worker", str(result), "--envs", env]
        command += ["--algorithms", algorithm, "--seeds", str(seed)]
        command += ["--devices", str(options.devices)]
        command += [word for text in options.set for word in ("--set", text)]
        print(f"{env} by {algorithm}, seed {seed}", flush=True)
        start = time.time()
        subprocess.run(command, check=True)
        run = json.loads(result.read_text())
    before = run.pop("started") - start  # of Python and the imports
    for row in run["history"]:
        row["seconds"] += before
    last = run["history"][-1]
    print(f"  return {last['eval_return']:.1f} after {last['seconds']:.0f} s", flush=True)
    return run


def work(options: argparse.Namespace) -> None:
    """One training, in this process."""
    import jax

    common.setup(devices=options.devices)
    started = time.time()
    import jaxsim

    (env,), (algorithm,), (seed,) = options.envs, options.algorithms, options.seeds
    result = jaxsim.rl.train(env, algorithm, overrides=options.set, seed=seed, progress=True)
    keep = ("steps", "seconds", "episode_return", "eval_return", "eval_return_std", "nonfinite")
    record = {
        "env": env,
        "algorithm": algorithm,
        "seed": seed,
        "set": options.set,
        "started": started,
        "devices": len(jax.devices()),
        "history": [{k: row[k] for k in keep if k in row} for row in _thin(result.history)],
        "in_mujoco": in_gymnasium(env, result.policy),
    }
    options.worker.write_text(json.dumps(record))


def in_gymnasium(env: str, policy, episodes: int = 10) -> float | None:
    """Mean return of a policy in Gymnasium's task, simulated by MuJoCo C."""
    if env not in GYMNASIUM:
        return None
    import gymnasium
    import jax
    import numpy as np

    act, task = jax.jit(policy), gymnasium.make(GYMNASIUM[env])
    total = 0.0
    for episode in range(episodes):
        obs, over = task.reset(seed=episode)[0], False
        while not over:
            action = np.asarray(act(obs.astype(np.float32)))
            obs, reward, terminated, truncated, _ = task.step(action)
            total, over = total + float(reward), terminated or truncated
    task.close()
    return total / episodes


def summary(runs: list[dict]) -> list[dict]:
    """One row for each environment and algorithm: medians over the seeds."""
    rows = []
    for env, algorithm in dict.fromkeys((r["env"], r["algorithm"]) for r in runs):
        chosen = [r for r in runs if (r["env"], r["algorithm"]) == (env, algorithm)]
        goal, minutes = GOALS.get(env, (None, None))
        last = [r["history"][-1] for r in chosen]
        mujoco = [r["in_mujoco"] for r in chosen if r["in_mujoco"] is not None]
        rows.append(
            {
                "env": env,
                "algorithm": algorithm,
                "seeds": len(chosen),
                "goal": goal,
                "within": minutes,
                "reached": _reached(chosen, goal),
                "return": statistics.median(row["eval_return"] for row in last),
                "in MuJoCo C": statistics.median(mujoco) if mujoco else None,
                "minutes": statistics.median(row["seconds"] for row in last) / 60,
                "steps": statistics.median(row["steps"] for row in last),
                "steps/s": statistics.median(_speed(r) for r in chosen),
            }
        )
    return rows


def _reached(runs: list[dict], goal: float | None) -> float | None:
    """Minutes to the first evaluation that reached the goal, median of all seeds."""
    if goal is None:
        return None
    never = [float("inf")]
    times = [
        min([r["seconds"] for r in run["history"] if r.get("eval_return", -1e9) >= goal] + never)
        for run in runs
    ]
    median = statistics.median(times) / 60
    return None if median == float("inf") else median


def _speed(run: dict) -> float:
    """Environment steps per second once compiled, learning and evaluations included."""
    first, last = run["history"][0], run["history"][-1]
    return (last["steps"] - first["steps"]) / max(last["seconds"] - first["seconds"], 1e-9)


def _thin(history: list[dict], count: int = 200) -> list[dict]:
    """Evaluations, the first row, and some of the others."""
    every = max(1, len(history) // count)
    return [row for i, row in enumerate(history) if i % every == 0 or "eval_return" in row]


def _draw(options: argparse.Namespace, env: str, runs: list[dict]) -> None:
    if options.dry:
        return
    from jaxsim.viz.plots.learning import plot_learning

    curves = {f"{r['algorithm']}, seed {r['seed']}": r["history"] for r in runs}
    name = options.name or pathlib.Path(__file__).stem
    goal = GOALS.get(env, (None,))[0]
    plot_learning(curves, options.out / f"{name}-{env}.png", env, goal)


def _earlier(options: argparse.Namespace) -> list[dict]:
    path = (options.out / (options.name or pathlib.Path(__file__).stem)).with_suffix(".json")
    return json.loads(path.read_text())["runs"] if path.exists() else []


def _key(run: dict) -> tuple:
    return run["env"], run["algorithm"], run["seed"]


def _options() -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=1)
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--envs", nargs="+", default=list(GOALS), help="environments (all)")
    parser.add_argument("--algorithms", nargs="+", help="ppo, sac, apg, shac (the usual one)")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2], help="seeds (0 1 2)")
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE, as `jaxsim train`")
    parser.add_argument("--devices", type=int, default=2, help="devices, one for each core (2)")
    parser.add_argument("--worker", type=pathlib.Path, help=argparse.SUPPRESS)
    return parser.parse_args()


if __name__ == "__main__":
    main()
