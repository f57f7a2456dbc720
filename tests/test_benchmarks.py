"""The benchmarks run: their help, and tiny measurements whose numbers are finite and accurate."""

import json
import os
import pathlib
import subprocess
import sys

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim

REPOSITORY = pathlib.Path(__file__).parent.parent
SCRIPTS = REPOSITORY / "benchmarks"


def run(script: str, *arguments) -> str:
    """Output of a benchmark, run as a user would."""
    paths = [str(REPOSITORY), os.environ.get("PYTHONPATH", "")]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in paths if p)}
    command = [sys.executable, str(SCRIPTS / script), *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture
def common(benchmark_module):
    """The shared helpers, imported as the scripts import them."""
    return benchmark_module("common")


@pytest.fixture
def gpu(benchmark_module):
    """The benchmark of GPUs."""
    return benchmark_module("gpu")


@pytest.fixture
def page(benchmark_module):
    """The generator of the benchmarks' page."""
    return benchmark_module("page")


def test_page_is_that_of_the_results(page):
    """After a measurement, `python benchmarks/page.py` writes the page anew."""
    assert page.main(["--check"]) == 0


def test_page_has_every_result(page):
    text = page.page()
    for file in (SCRIPTS / "results").glob("*.json"):
        assert json.loads(file.read_text())["command"] in text, file.name


@pytest.mark.parametrize("script", ["dynamics.py", "solver.py", "throughput.py"])
def test_help_says_what_is_measured(script):
    assert "MuJoCo C" in run(script, "--help")


def test_timing_summarises_samples(common):
    timing = common.Timing.of([4.0, 1.0, 2.0, 3.0, 100.0])
    assert (timing.median, timing.best) == (3.0, 1.0)
    assert timing.spread == (4.0 - 2.0) / 2
    assert timing.per(2).median == 1.5


def test_candidates_take_turns(common):
    calls = []
    candidates = {name: lambda name=name: calls.append(name) for name in "ab"}
    ticks = iter(range(1000))
    timings = common.interleave(candidates, 3, at_least=1.0, clock=lambda: next(ticks))
    assert calls == ["a", "a", "b", "b", *"ababab"]
    assert all(len(t.samples) == 3 for t in timings.values())


def test_a_model_of_menagerie_needs_its_folder(benchmark_module, tmp_path):
    models = benchmark_module("models")
    with pytest.raises(FileNotFoundError, match="--menagerie"):
        models.load("go2")
    with pytest.raises(FileNotFoundError, match=str(tmp_path)):
        models.load("go2", tmp_path)


def test_an_arm_gets_a_box_that_rests_on_the_floor(benchmark_module, tmp_path):
    models = benchmark_module("models")
    file = tmp_path / models.MENAGERIE["panda_box"]
    file.parent.mkdir()
    file.write_text("""<mujoco><worldbody><geom type="plane" size="1 1 1"/>
      <body pos="0 0 1"><joint name="j" axis="1 0 0"/><geom size=".1"/></body></worldbody>
      <keyframe><key qpos="0.3"/></keyframe></mujoco>""")
    mj = models.load("panda_box", tmp_path)
    data = models.start(mj)
    mujoco.mj_forward(mj, data)
    assert data.qpos[0] == 0.3
    assert data.ncon == 4
    np.testing.assert_allclose(data.contact.dist, 0, atol=1e-12)


def test_table_aligns_columns(common):
    lines = common.table([{"name": "a", "x": 0.5}, {"name": "long", "y": 12345.0}]).splitlines()
    assert len({len(line) for line in lines}) == 1
    assert lines[0].split() == ["name", "x", "y"]
    assert "12,345" in lines[2]


def test_a_short_soak(tmp_path):
    run("soak.py", "--models", "pendulum", "--steps", 1, "--batch", 16, "--out", tmp_path)
    (row,) = json.loads((tmp_path / "soak.json").read_text())["rows"]
    assert row["steps"] == 16 * 50 * 3
    assert (row["diverged"], row["alone"], row["compilations"]) == (0, 0, 0)


def test_a_soak_asks_mujoco_about_what_diverged(common):
    import soak

    xml = """<mujoco><worldbody><body><joint name="j"/><geom size=".1"/></body></worldbody>
      <actuator><motor joint="j" gear="{}"/></actuator></mujoco>"""
    count = soak.Counts()
    for gear in ("1", "1e15"):
        mj = mujoco.MjModel.from_xml_string(xml.format(gear))
        states = jax.tree.map(lambda x: x[None], jaxsim.make_state(jaxsim.load(mj)))
        count.add(mj, states, np.ones((1, 5, 1)), np.array([True]), np.zeros(1))
    assert (count.diverged, count.alone) == (2, 1)


def test_a_rate_on_a_gpu_is_measured(gpu):
    """In tiny sizes, as `gpu.py --cpu` has them, but in this process."""
    import gpu_worker

    row = _tiny_rows(gpu)["rate"]
    assert gpu_worker.rate(row, prepare=True)["compile s"] > 0
    assert gpu_worker.rate(row, prepare=False)["steps/s"] > 0


@pytest.mark.slow
def test_other_rows_of_a_gpu_are_measured(gpu):
    import gpu_worker

    rows = _tiny_rows(gpu)
    errors = gpu_worker.check(rows["check"], prepare=False)
    assert max(errors["qacc error"], errors["gradient error"]) < 1e-4
    for kind in ("gradient", "train"):
        assert getattr(gpu_worker, kind)(rows[kind], prepare=False)["steps/s"] > 0


def _tiny_rows(gpu):
    """One of our own engine's for each kind."""
    jobs = [j for j in gpu._tiny_jobs(gpu._options(["--cpu"])) if j["engine"][0] != "m"]
    rows = {j["kind"]: j | {"batch": j["batch"][0]} for j in jobs}
    assert set(rows) == {"check", "rate", "gradient", "train"}
    return rows


def test_a_row_of_a_gpu_that_fails_says_why_and_stops_no_other(gpu, monkeypatch, capsys):
    fail = [
        gpu._row("rate", "double_pendulum", "x", 1, steps=1),
        gpu._row("check", "nobody", "x", 1),
    ]
    monkeypatch.setattr(gpu, "_tiny_jobs", lambda options: fail)
    gpu.main(["--cpu"])
    said = capsys.readouterr().out
    assert "repetitions" in said
    assert "nobody" in said


@pytest.mark.slow
def test_dynamics_writes_accurate_results(tmp_path):
    run("dynamics.py", "--sizes", 8, "--batch", 4, "--repetitions", 2, "--x64", "--out", tmp_path)
    record = json.loads((tmp_path / "dynamics.json").read_text())
    assert len(record["rows"]) == 10
    assert max(row["relative error"] for row in record["rows"]) < 1e-10
    assert (tmp_path / "dynamics.png").stat().st_size > 0
    assert record["machine"]["mujoco"]


@pytest.mark.slow
def test_solver_compares_strategies(tmp_path):
    sizes = ("--batch", 4, "--states", 4, "--repetitions", 2)
    run("solver.py", "--models", "hopper", "--chains", 8, "--x64", *sizes, "--out", tmp_path)
    record = json.loads((tmp_path / "solver.json").read_text())
    timed = [row for row in record["rows"] if "us" in row]
    assert {row["solver"] for row in timed} == {"dense", "iterative", "MuJoCo C"}
    assert all(row["median error"] < 1e-4 for row in timed if "median error" in row)
    assert {row["contacts"] for row in record["chains"]} == {8.0}


@pytest.mark.slow
def test_precision_of_a_few_scenes(tmp_path):
    sizes = ("--scenes", 16, "--steps", 100, "--families", "sphere pyramidal")
    run("precision.py", *sizes, "--out", tmp_path)
    rows = {r["by"]: r for r in json.loads((tmp_path / "precision.json").read_text())["rows"]}
    assert set(rows) == {"float32", "float64", "MuJoCo C"}
    for row in rows.values():
        assert row["scenes"] == 16
        assert row["not finite"] == row["through"] == 0
    assert rows["float64"]["qacc error, median"] < 1e-9
    assert rows["float32"]["qacc error, median"] < 1e-3


def test_precision_counts_what_goes_wrong(benchmark_module):
    """Of three scenes one is right, one ends below the floor, one is not finite."""
    precision = benchmark_module("precision")

    rng = np.random.default_rng(0)
    scenes = [precision.draw(rng, "box", "elliptic") for _ in range(3)]
    exact = precision.mujoco_outcome(scenes, steps=2, converged=True)
    found = precision.mujoco_outcome(scenes, steps=2, converged=False)
    found.qpos[1, 2], found.qpos[2], found.qacc[2] = -1.0, np.nan, np.nan
    counts = precision.compare(scenes, found, exact, steps=2)
    assert (counts["not finite"], counts["through"]) == (1, 1)
    assert counts["worst"] == np.inf
    assert counts["qacc error, median"] < 1


@pytest.mark.slow
def test_gradients_with_known_answers(tmp_path):
    ways = ("program", "entry times", "MuJoCo")
    run("gradients.py", "--cases", "G3b", "--phases", 8, "--ways", *ways, "--out", tmp_path)
    rows = json.loads((tmp_path / "gradients.json").read_text())["rows"]
    (row,) = (row for row in rows if row["ms"] == 1)
    assert row["entry times ±"] < 0.1 * row["program ±"]
    assert row["program"] == pytest.approx(row["MuJoCo"], rel=1e-3)


def test_agreement_of_policy_gradients(common):
    """Two environments: one agrees, one is opposite and twice as long."""
    import policy_gradients

    found, expected = np.array([[1.0, 0.0], [0.0, -2.0]]), np.array([[1.0, 0.0], [0.0, 1.0]])
    agreement = policy_gradients.compare(found, expected)
    np.testing.assert_allclose(agreement["cosine"], -1 / np.sqrt(10))
    np.testing.assert_allclose(agreement["ratio"], np.sqrt(2.5))
    assert (agreement["of one"], agreement["norm"], agreement["largest"]) == (0.0, 1.5, 2.0)


@pytest.mark.slow
def test_policy_gradients_of_one_step(tmp_path):
    """A single step's gradient is that of differences."""
    sizes = ("--envs", "half_cheetah", "--softening", 1, "--batch", 16)
    run("policy_gradients.py", *sizes, "--out", tmp_path)
    first, *_ = json.loads((tmp_path / "policy_gradients.json").read_text())["rows"]
    assert first["steps"] == 1
    assert first["cosine"] > 0.99


@pytest.mark.slow
def test_gradients_are_accurate(tmp_path):
    sizes = ("--batch", 4, "--steps", 3, "--states", 4, "--repetitions", 2)
    run("gradient_cost.py", "--models", "double_pendulum", *sizes, "--out", tmp_path)
    (row,) = json.loads((tmp_path / "gradient_cost.json").read_text())["rows"]
    assert row["error"] < 1e-3
    assert row["float64 to differences"] < 1e-5
    assert row["forwards"] > 1
    assert row["bytes"] > 0


@pytest.mark.slow
def test_scaling_over_batches_and_devices(tmp_path):
    sizes = ("--batch", 4, 8, "--steps", 2, "--repetitions", 1, "--devices", 1, 2)
    run("scaling.py", "--model", "double_pendulum", *sizes, "--out", tmp_path)
    rows = json.loads((tmp_path / "scaling.json").read_text())["rows"]
    assert [(row["devices"], row["batch"]) for row in rows] == [(1, 4), (1, 8), (2, 4), (2, 8)]
    assert all(0 < row["of best"] <= 1 for row in rows)
    assert all(row["efficiency"] > 0 for row in rows)


@pytest.mark.slow
def test_throughput_of_all_cores(tmp_path):
    sizes = ("--batch", 4, "--steps", 2, "--states", 4, "--repetitions", 2)
    peers = ("--models", "double_pendulum", "--peers", "mujoco,vmap")
    run("throughput.py", *peers, *sizes, "--json", tmp_path / "out.json")
    rows = {row["peer"]: row for row in json.loads((tmp_path / "out.json").read_text())["rows"]}
    assert [*rows] == ["jaxsim", "mujoco", "vmap"]
    assert all(np.isfinite(row["steps/s"]) for row in rows.values())
    assert max(rows[peer]["qacc error"] for peer in ("jaxsim", "vmap")) < 1e-3


def test_kernels_of_a_program_are_counted(benchmark_module):
    """Those of a branch apart, and of a table only the row that is read."""
    gpu_programs = benchmark_module("gpu_programs")

    def rollout(x, table):
        def body(x, row):
            return jax.lax.cond(row[0] > 0, jnp.sin, lambda x: x, x) + row, None

        return jax.lax.scan(body, x, table)[0]

    x, table = jnp.zeros(1000), jnp.zeros((gpu_programs.STEPS, 1000))
    # A CPU may put a small loop into a call, which a GPU does not.
    options = {"xla_disable_hlo_passes": "small-while-loop-hoisting"}
    compiled = jax.jit(rollout).lower(x, table).compile(options)
    program = gpu_programs.Program(compiled)
    assert [program.size([kernel]) for kernel in program.inner] == [2 * x.nbytes]
    assert program.calls == []
    # The sum has two operands and a result; one of these may be copied.
    sizes = [program.size([kernel]) for kernel in program.kernels]
    assert 3 * x.nbytes <= sum(sizes) < 6 * x.nbytes < table.nbytes
    per_turn = len(program.kernels) + len(program.inner)
    assert gpu_programs.launches(compiled) >= gpu_programs.STEPS * per_turn


def test_what_the_host_waits_for(benchmark_module):
    """A loop of unknown length that is not recorded, a branch in it, and what the host does."""
    host_waits = benchmark_module("host_waits")
    x = jnp.ones(8)

    def waits(f):
        return host_waits.host_waits(jax.jit(f).lower(x).compile())

    halve = lambda x: jax.lax.while_loop(lambda x: x[0] > 1, lambda x: x / 2, x)  # noqa: E731
    choose = lambda x: jax.lax.cond(x[0] > 1, jnp.sin, lambda x: 2 * x, x)  # noqa: E731
    assert len(waits(halve)) == 1, "too few operations for a command buffer"
    assert len(waits(lambda x: halve(choose(x)))) == 2
    assert waits(lambda x: jax.lax.fori_loop(0, 9, lambda _, x: jnp.cumsum(x), x)) == []
    transform = lambda x: jnp.fft.ifft(jnp.fft.fft(x)).real + 1  # noqa: E731
    again = lambda f: lambda x: jax.lax.fori_loop(0, 9, lambda _, x: f(x), x)  # noqa: E731
    assert len(waits(again(lambda x: halve(transform(x))))) == 1
    said = waits(again(lambda x: jax.pure_callback(np.sin, x, x)))
    assert len(said) == 1
    assert "custom-call" in said[0] or "callback" in said[0]


def test_loops_of_a_long_program_are_recorded(benchmark_module):
    """Side by side with enough others a loop of unknown length is part of a command buffer."""
    host_waits = benchmark_module("host_waits")

    def f(x):
        for i in range(host_waits.SMALLEST):
            x = jax.lax.while_loop(lambda x: x[0] > 1, lambda x, i=i: jnp.roll(x, i) / 2, x)
        return x

    assert host_waits.host_waits(jax.jit(f).lower(jnp.ones(8)).compile()) == []


@pytest.mark.parametrize("way", ["_compiled", "_vector"])
def test_environments_are_stepped(way, benchmark_module):
    environments = benchmark_module("environments")

    getattr(environments, way)("inverted_pendulum", 4, 2)()


def test_contacts_of_a_pair_are_compared(benchmark_module):
    """A pair in closed form, at a few poses of each kind."""
    collision = benchmark_module("collision")
    sizes = ["--poses", "40", "--repetitions", "1"]
    row = collision.measure(("plane", "cylinder"), collision._options(sizes))
    regimes = benchmark_module("collision_poses").REGIMES
    assert max(row[f"{by}{regime}"] for by in ("", "MuJoCo ") for regime in regimes) < 1e-12
    assert max(row["float32"], row["aligned"]) < 1e-6
    assert row["gradient"] < 1e-8
    assert (row["contacts"], row["not finite"]) == (1, 0)


def test_scenes_move_as_in_mujoco(benchmark_module):
    """Two boxes that fall on each other."""
    scenes = benchmark_module("collision_scenes")
    mj = scenes.stack(2)
    row = scenes.compared(mj, np.zeros((60, 0)), "float64")
    assert (row["finite"], row["lost"]) == (True, 0)
    assert row["deepest"] > 1e-5
    assert max(row["apart"], row["energy"]) < 1e-9


def test_a_resting_body_is_carried_as_in_mujoco(benchmark_module):
    scenes = benchmark_module("collision_scenes")
    row = scenes.support(("plane", "sphere"), 2, "float64")
    assert max(row[key] for key in ("force", "torque", "pos", "turn")) < 1e-8


def test_truth_of_distances(benchmark_module):
    """A cylinder's rim above a box's corner, its cap on a face, and its middle in the other's."""
    truth, poses = benchmark_module("collision_truth"), benchmark_module("collision_poses")
    mj = poses.model(("cylinder", "box"), 0.0)
    gap = np.array([0.09 / np.sqrt(2) + 0.03, 0.09 / np.sqrt(2) + 0.04, 0.12 + 0.01])
    places = np.array([[0, 0, 0.12 + 0.14 + 0.01], mj.geom_size[1] + gap, [0, 0, 0]])
    pos = np.stack([np.zeros((3, 3)), places], axis=1)
    found = truth.signed_distances(mj, pos, np.tile(np.eye(3), (3, 2, 1, 1)))
    rim = np.hypot(np.hypot(*gap[:2]) - 0.09, 0.01)
    np.testing.assert_allclose(found, [0.01, rim, -0.17], atol=1e-9)


def test_coverage_counts_what_loads_and_why_not(tmp_path):
    """A model, one with what is not supported, one that MuJoCo refuses, one without joints."""
    body = '<body><freejoint/><geom size=".1"/></body>'
    option = '<option integrator="discrete"/>'
    files = {
        "good": f"<mujoco><worldbody>{body}</worldbody></mujoco>",
        "option": f"<mujoco>{option}<worldbody>{body}</worldbody></mujoco>",
        "broken": "<mujoco><worldbody>",
        "still": "<mujoco/>",
    }
    for name, xml in files.items():
        (tmp_path / f"{name}.xml").write_text(xml)
    run("coverage.py", tmp_path, "--out", tmp_path)
    found = json.loads((tmp_path / "coverage.json").read_text())
    assert found["summary"]["models"] == 2
    assert found["summary"]["load"] == 1
    assert [(r["files"], r["alone"]) for r in found["reasons"]] == [(1, 1)]
    assert "integrator" in found["reasons"][0]["reason"]
