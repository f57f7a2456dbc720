"""Damaged MJCF: each file ends as MuJoCo's model or as one `ModelError` with a reason.

`python tests/io/fuzz.py --files 10000` tries many. Files are tried in processes of their own, in
batches, as MuJoCo's compiler may crash or hang; what it does is not ours to judge.
"""

import argparse
import collections
import json
import os
import pathlib
import resource
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator

import mujoco
import numpy as np

SECONDS, MEMORY = 240, 12 << 30  # what one file, and one process, may need
MODELS = "pendulum cartpole hopper arm four_bar box_on_plane reacher swimmer acrobot".split()
SHAPES = """<mujoco><asset><mesh name="rock" scale="1 1 1" maxhullvert="9"
  vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1 .07 .07 .07"/></asset><worldbody>
  <geom type="plane" size="1 1 1"/><geom type="ellipsoid" size=".2 .1 .1"/>
  <body pos="0 .2 .01"><freejoint/><geom type="mesh" mesh="rock"/></body>
  <body pos=".3 0 .1"><freejoint/><geom type="cylinder" size=".05 .1"/></body>
  </worldbody></mujoco>"""
SIZES = "nq nv nu na nbody njnt ngeom nsite neq ntendon nsensor nsensordata nkey nmocap".split()
TOLERANCE = 1e-6
# Of a flat contact of such shapes MuJoCo keeps other points than we do.
CONVEX = [int(getattr(mujoco.mjtGeom, f"mjGEOM_{s}")) for s in ("ELLIPSOID", "CYLINDER", "MESH")]
# Beyond them float64 has few digits left, for MuJoCo too: ratio of inertias, distances (m).
HEAVIEST, FARTHEST = 1e10, 1e6


def outcomes(first: int, count: int, programs: int) -> Iterator[dict]:
    """What became of the files with these seeds; tried in processes that go on after a crash.

    Args:
      first: seed of the first file.
      count: number of files.
      programs: how many programs a process may compile to compare accelerations.
    """
    while count > 0:
        done = 0
        for outcome in _in_a_process(first, count, programs):
            done += 1
            yield outcome
        first, count = first + done, count - done


def _in_a_process(first: int, count: int, programs: int) -> Iterator[dict]:
    """The outcomes until the process ends; that of the file which it died of is the last one."""
    here = pathlib.Path(__file__).resolve()
    paths = os.pathsep.join(map(str, (here.parents[2], here.parents[1])))
    command = [sys.executable, str(here), "--worker", str(first), str(count), str(programs)]
    asked, done = None, 0
    # MuJoCo writes a log into the current folder.
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen(
            command,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            cwd=folder,
            env={**os.environ, "PYTHONPATH": paths, "JAX_PLATFORMS": "cpu"},
        ) as worker,
    ):
        for line in worker.stdout:
            if line.startswith("{"):
                done += 1
                yield json.loads(line)
            elif line.strip() in ("mujoco", "jaxsim"):
                asked = line.strip()
    code = worker.returncode
    if done < count:
        how = "hangs" if code == -signal.SIGALRM else f"dies of {code}"
        yield {"seed": first + done, "end": f"{asked} {how}", "wrong": asked != "mujoco"}


def _work(first: int, count: int, programs: int) -> None:
    """Try files one after another; a line says who is asked, so that a crash has a culprit."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    warnings.simplefilter("error")
    comparison = Comparison(programs)
    for seed in range(first, first + count):
        signal.setitimer(signal.ITIMER_REAL, SECONDS)
        print("mujoco", flush=True)
        xml = _file(seed)
        try:
            mj = mujoco.MjModel.from_xml_string(xml)
        except Exception as error:
            mj = error
        print("jaxsim", flush=True)
        wrong, end = _judged(xml, mj, comparison)
        print(json.dumps({"seed": seed, "end": end, "wrong": wrong}), flush=True)


def _file(seed: int) -> str:
    from mjcf_mutations import mutated

    from jaxsim.io import bundled_xml

    k = seed % (len(MODELS) + 1)
    xml = mutated(bundled_xml(MODELS[k]) if k < len(MODELS) else SHAPES, seed)
    return xml if xml.lstrip().startswith("<") else "<" + xml  # what else is a path to `load`


def _judged(xml: str, mj, comparison: "Comparison") -> tuple[bool, str]:
    """Whether the outcome is wrong, and what it is."""
    import jax

    import jaxsim

    jax.config.update("jax_enable_x64", True)
    try:
        model = jaxsim.load(xml)
    except jaxsim.ModelError as error:
        refused = isinstance(mj, Exception)
        return not str(error), "malformed" if refused else "refused"
    except Exception as error:
        return True, f"{type(error).__name__}: {error}"
    if isinstance(mj, Exception):
        return True, f"loads, though MuJoCo says {mj}"
    differing = [name for name in SIZES if getattr(mj, name) != getattr(model, name)]
    if differing:
        return True, f"other sizes: {differing}"
    return comparison(mj, model)


class Comparison:
    """Accelerations beside MuJoCo's; of so many different programs only, as each is compiled."""

    def __init__(self, programs: int):
        self.programs, self.seen = programs, set()

    def __call__(self, mj, model) -> tuple[bool, str]:
        """Whether the accelerations are wrong, and what they are."""
        import jax
        from oracle import quick_jit

        import jaxsim

        program = jax.tree.structure(model)
        if program not in self.seen and len(self.seen) >= self.programs:
            return False, "loads"
        if not self.seen:
            self.forward = quick_jit(lambda m, s: jaxsim.forward(m, s).qacc)
        self.seen.add(program)
        if _beyond_float64(mj):
            return False, "too far or too heavy to compare"
        if np.isin(mj.geom_type, CONVEX).any():
            return False, "loads"
        mj.opt.tolerance, mj.opt.iterations, mj.opt.ls_iterations = 0, 100, 50
        model = jaxsim.load(mj)
        qvel = np.random.default_rng(0).normal(size=mj.nv)
        state = jaxsim.make_state(model).replace(qvel=jax.numpy.asarray(qvel))
        ours = np.asarray(self.forward(model, state))
        try:
            theirs, nudged = (_acceleration(mj, qvel + nudge) for nudge in (0, 1e-9))
        except mujoco.FatalError:  # too little memory, for instance
            return False, "MuJoCo cannot simulate it"
        if not np.abs(theirs).max(initial=0) < mujoco.mjMAXVAL:
            return False, "MuJoCo would reset it"
        # What a nudge of 1e-9 changes is not determined any better.
        allowed = TOLERANCE * (1 + np.abs(theirs).max(initial=0)) + np.abs(nudged - theirs)
        worst = np.max(np.abs(ours - theirs) / allowed, initial=0)
        return not worst <= 1, "agrees" if worst <= 1 else f"accelerations differ: {ours} {theirs}"


def _beyond_float64(mj: mujoco.MjModel) -> bool:
    lightest = mj.dof_M0.min(initial=np.inf)
    lengths = np.concatenate([mj.body_pos, mj.geom_pos, mj.geom_size, mj.eq_data[:, :3]])
    return mj.dof_M0.max(initial=0) / HEAVIEST > lightest or np.abs(lengths).max() > FARTHEST


def _acceleration(mj: mujoco.MjModel, qvel: np.ndarray) -> np.ndarray:
    data = mujoco.MjData(mj)
    data.qvel[:] = qvel
    mujoco.mj_forward(mj, data)
    return data.qacc.copy()


def main() -> None:
    """Try files, tell how many ended how, and list those that ended wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=10_000)
    parser.add_argument("--first", type=int, default=0, help="seed of the first file")
    parser.add_argument("--programs", type=int, default=20, help="programs that may be compiled")
    arguments = parser.parse_args()
    ends = collections.Counter()
    for outcome in outcomes(arguments.first, arguments.files, arguments.programs):
        ends[outcome["end"][:60]] += 1
        if outcome["wrong"]:
            print(json.dumps(outcome), flush=True)
    print(json.dumps(dict(ends.most_common()), indent=2))


if __name__ == "__main__":
    if sys.argv[1:2] == ["--worker"]:
        _work(*map(int, sys.argv[2:]))
    else:
        main()
