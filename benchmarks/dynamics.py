"""Recursions over trees of 8 to 512 links: run time, compile time and error, beside MuJoCo C.

RNEA, CRBA and ABA start from coordinates, so kinematics are in their times on both sides; `solve`
is `M^-1 f` where kinematics are known. For MuJoCo that is
  kinematics: mj_kinematics, mj_comPos
  RNEA: kinematics, mj_comVel, mj_rne with accelerations
  CRBA: kinematics, mj_crb
  ABA: kinematics, mj_comVel, mj_rne, mj_crb, mj_factorM, mj_solveM
  solve: mj_crb, mj_factorM, mj_solveM
called one by one from Python on one thread. What the calls themselves cost is measured on an
empty model and subtracted. jaxsim runs `--batch` environments, batch last, on one thread, in chunks
of fewer lanes where the trees are large, so that a chunk stays in cache. CRBA writes a full
matrix and gets fewer environments where that would not fit into memory.
"""

import argparse

import common
import mujoco
import numpy as np

ALGORITHMS = ("kinematics", "rnea", "crba", "aba", "solve")
# Entries of all mass matrices of a batch together.
CRBA_ENTRIES = 2**24
# Links of all environments of a chunk together.
CHUNK_LINKS = 2**15
MIN_LANES = 32


def main(arguments=None) -> None:
    options = _options(arguments)
    common.setup(x64=options.x64)
    rows = []
    for shape in options.shapes:
        for n in options.sizes:
            rows += _measure(shape, n, options)
            print(common.table(rows[-len(options.algorithms) :]), flush=True)
    verdicts = _scaling(rows)
    print(common.table(verdicts))
    common.write(options, __file__, {"rows": rows, "scaling": verdicts}, lambda f: _draw(f, rows))


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=15)
    parser.add_argument("--sizes", type=int, nargs="+", default=[8, 16, 32, 64, 128, 256, 512])
    parser.add_argument(
        "--shapes", nargs="+", default=["chain", "binary"], choices=["chain", "binary"]
    )
    parser.add_argument("--algorithms", nargs="+", default=list(ALGORITHMS), choices=ALGORITHMS)
    parser.add_argument("--batch", type=int, default=256, help="environments")
    parser.add_argument("--x64", action="store_true", help="float64")
    return parser.parse_args(arguments)


def make_tree(shape: str, n: int) -> mujoco.MjModel:
    """A chain, or a tree in which body i hangs on body (i - 1) // 2; n hinges, no geoms."""
    spec = mujoco.MjSpec()
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    bodies = []
    for i in range(n):
        parent = i - 1 if shape == "chain" else (i - 1) // 2
        above = bodies[parent] if i else spec.worldbody
        offset = [0.02 * (-1) ** i, 0.01 * (-1) ** (i // 2), 0.05]
        body = above.add_body(pos=offset if i else [0, 0, 0])
        body.mass, body.inertia, body.ipos = 0.1, [2e-4, 3e-4, 4e-4], [0.005, 0, 0.025]
        body.explicitinertial = True
        body.add_joint(axis=np.roll([1, 0.2, 0], i), armature=0.05)
        bodies.append(body)
    return spec.compile()


def _measure(shape: str, n: int, options) -> list[dict]:
    """One row for each algorithm."""
    import jaxsim

    mj = make_tree(shape, n)
    model, inputs = jaxsim.load(mj), _inputs(n, options.batch)
    programs = {a: _program(a, model, inputs, n) for a in options.algorithms}
    candidates = {a: run for a, (run, _, _) in programs.items()}
    data, empty = _oracle_data(mj, inputs), mujoco.MjModel.from_xml_string("<mujoco/>")
    for a in options.algorithms:
        candidates[f"mujoco {a}"] = _mujoco_calls(a, mj, data)
        candidates[f"calls {a}"] = _mujoco_calls(a, empty, mujoco.MjData(empty))
    times = common.interleave(candidates, options.repetitions, clock=options.clock)
    return [_row(a, shape, n, programs[a], times, mj, inputs) for a in options.algorithms]


def _row(a, shape, n, program, times, mj, inputs) -> dict:
    run, batch, compile_seconds = program
    ours = times[a].per(batch)
    theirs = times[f"mujoco {a}"].median - times[f"calls {a}"].median
    return {
        "algorithm": a,
        "tree": shape,
        "links": n,
        "batch": batch,
        "jaxsim us": ours.median * 1e6,
        "spread": ours.spread * 1e6,
        "best": ours.best * 1e6,
        "mujoco us": theirs * 1e6,
        "mujoco/jaxsim": theirs / ours.median,
        "compile s": compile_seconds,
        "relative error": _error(a, mj, inputs, run()),
    }


def _inputs(n: int, lanes: int) -> np.ndarray:
    """(4, lanes, n): positions, velocities, accelerations, forces."""
    scale = np.array([0.5, 0.5, 1.0, 1.0])[:, None, None]
    return scale * np.random.default_rng(n).standard_normal((4, lanes, n))


def _program(algorithm: str, model, inputs: np.ndarray, n: int):
    """The batch of an algorithm: how to run it, its environments, seconds to compile."""
    import jax
    import jax.numpy as jnp

    import jaxsim
    from jaxsim.dynamics.aba import solve_mass
    from jaxsim.dynamics.kinematics import kinematics

    batch = inputs.shape[1]
    if algorithm == "crba":
        batch = max(1, min(batch, CRBA_ENTRIES // n**2))
    qpos, qvel, qacc, tau = (jnp.asarray(x[:batch], jnp.result_type(float)) for x in inputs)

    f, args = {
        "kinematics": (lambda q: _used(kinematics(model, q)), (qpos,)),
        "rnea": (lambda *x: jaxsim.inverse_dynamics(model, *x), (qpos, qvel, qacc)),
        "crba": (lambda q: jaxsim.mass_matrix(model, q), (qpos,)),
        "aba": (lambda *x: jaxsim.forward_dynamics(model, *x), (qpos, qvel, tau)),
        "solve": (lambda kin, f: solve_mass(model, kin, f), None),
    }[algorithm]
    if args is None:
        args = (jax.jit(jaxsim.vmap(lambda q: kinematics(model, q)))(qpos), tau)
    lanes = max(MIN_LANES, CHUNK_LINKS // n)
    lanes = batch if batch % lanes else lanes
    run, _, seconds = common.compile_for(common.in_chunks(f, lanes), *args)
    return run, batch, seconds


def _used(kin):
    """Positions of the bodies, and what the recursions need of the kinematics."""
    return kin.xpos, kin.cdof, kin.inertia, kin.origin


def _oracle_data(mj, inputs) -> mujoco.MjData:
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:], data.qacc[:] = inputs[0, 0], inputs[1, 0], inputs[2, 0]
    mujoco.mj_forward(mj, data)
    return data


def _mujoco_calls(algorithm: str, mj, data):
    """The stages of an algorithm, as one function without arguments."""
    x, y = np.zeros((1, mj.nv)), np.ones((1, mj.nv))
    bias = np.zeros(mj.nv)
    kinematics = [
        lambda: mujoco.mj_kinematics(mj, data),
        lambda: mujoco.mj_comPos(mj, data),
    ]
    velocity = [lambda: mujoco.mj_comVel(mj, data)]
    solve = [
        lambda: mujoco.mj_crb(mj, data),
        lambda: mujoco.mj_factorM(mj, data),
        lambda: mujoco.mj_solveM(mj, data, x, y),
    ]
    stages = {
        "kinematics": kinematics,
        "rnea": [*kinematics, *velocity, lambda: mujoco.mj_rne(mj, data, 1, bias)],
        "crba": [*kinematics, solve[0]],
        "aba": [*kinematics, *velocity, lambda: mujoco.mj_rne(mj, data, 0, bias), *solve],
        "solve": solve,
    }[algorithm]

    def run():
        for stage in stages:
            stage()

    return run


def _error(algorithm: str, mj, inputs, result) -> float:
    """Largest difference to MuJoCo over a few lanes, relative to the largest entry."""
    result = np.asarray(result[0] if algorithm == "kinematics" else result)
    pairs = [
        (result[i], _expected(algorithm, mj, inputs[:, i])) for i in range(min(4, len(result)))
    ]
    return float(max(np.abs(a - e).max() / np.abs(e).max() for a, e in pairs))


def _expected(algorithm: str, mj, inputs) -> np.ndarray:
    qpos, qvel, qacc, tau = inputs
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(mj, data)
    if algorithm == "kinematics":
        return data.xpos.copy()
    if algorithm == "crba":
        mass = np.zeros((mj.nv, mj.nv))
        mujoco.mj_fullM(mj, data, mass)
        return mass
    data.qacc[:] = qacc
    if algorithm == "rnea":
        force = np.zeros(mj.nv)
        mujoco.mj_rne(mj, data, 1, force)
        return force + mj.dof_armature * qacc
    force = tau - data.qfrc_bias if algorithm == "aba" else tau
    x = np.zeros((1, mj.nv))
    mujoco.mj_solveM(mj, data, x, force[None])
    return x[0]


def _scaling(rows) -> list[dict]:
    """How time and compile time grow from the smallest to the largest tree."""
    result = []
    for tree, a in dict.fromkeys((r["tree"], r["algorithm"]) for r in rows):
        line = {r["links"]: r for r in rows if (r["tree"], r["algorithm"]) == (tree, a)}
        low, high = min(line), max(line)
        middle = 16 if 16 in line else low
        per_link = [line[n]["best"] / n for n in (low, high)]
        compiling = [line[n]["compile s"] for n in (middle, high)]
        result.append(
            {
                "algorithm": a,
                "tree": tree,
                "links": f"{low}..{high}",
                "time per link, grown by": per_link[1] / per_link[0],
                f"compile time, {high} : {middle} links": compiling[1] / compiling[0],
            }
        )
    return result


def _draw(figure, rows) -> None:
    """Time per environment, and compile time, against the number of links."""
    left, right = figure.subplots(1, 2)
    for tree, dash in (("chain", "-"), ("binary", ":")):
        for i, a in enumerate(ALGORITHMS):
            line = [r for r in rows if (r["tree"], r["algorithm"]) == (tree, a)]
            if not line:
                continue
            links = [r["links"] for r in line]
            left.loglog(links, [r["jaxsim us"] for r in line], f"C{i}{dash}", label=f"{a}, {tree}")
            left.loglog(links, [r["mujoco us"] for r in line], f"C{i}{dash}", alpha=0.3, lw=3)
            right.semilogx(links, [r["compile s"] for r in line], f"C{i}{dash}")
    left.set(xlabel="links", ylabel="us per environment", title="one thread (pale: MuJoCo C)")
    right.set(xlabel="links", ylabel="s", title="compile time", ylim=(0, None))
    left.legend(fontsize=7)


if __name__ == "__main__":
    main()
