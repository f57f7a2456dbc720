"""A job of `gpu.py`, in a process of its own: prepares it, or times it. Each row is a line of JSON.

Preparing compiles into JAX's persistent cache and runs nothing, so that many rows can be prepared
at a time; timing then finds the programs there and has the device for itself.
"""

import argparse
import contextlib
import json
import os
import statistics
import time

import models
import numpy as np

HORIZON = 32  # steps of a gradient


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("row", type=json.loads, help="a row of gpu.py as JSON")
    parser.add_argument("--prepare", action="store_true", help="compile only")
    options = parser.parse_args()
    _set_kernels(options.row)
    measure = {"rate": rate, "check": check, "gradient": gradient, "train": train}
    with contextlib.suppress(ImportError):
        import warp

        warp.config.quiet = True
    row = options.row
    for batch in row["batch"]:
        found = measure[row["kind"]](row | {"batch": batch}, options.prepare)
        print(json.dumps({"batch": batch} | found, default=float), flush=True)


def _set_kernels(row: dict) -> None:
    """One kernel for a step, or XLA's program."""
    if row["kind"] == "train":
        return
    from jaxsim.lanes.switch import enable_lanes

    enable_lanes(row["engine"] == "kernel")


def rate(row: dict, prepare: bool) -> dict:
    """Steps per second of a rollout of a batch."""
    mj = _model(row)
    if row["engine"] == "mujoco_warp":
        return {} if prepare else _warp_rate(mj, row)
    f, args = _batch(mj, row)
    return _timed(f, args, row["batch"] * row["steps"], row, prepare)


def gradient(row: dict, prepare: bool) -> dict:
    """Steps per second, forward and back, of the gradient of a final height by all controls."""
    import jax

    mj = _model(row)
    loss, (states, ctrls) = _batch(mj, row | {"steps": HORIZON}, loss=True)
    f = lambda s, u: jax.grad(lambda u: loss(s, u).sum())(u)  # noqa: E731
    return _timed(f, (states, ctrls), row["batch"] * HORIZON, row, prepare)


def check(row: dict, prepare: bool) -> dict:
    """Errors on this device against MuJoCo C, and of a gradient against float64 on the CPU."""
    import jax
    import jax.numpy as jnp

    import jaxsim
    from jaxsim.lanes import as_kernel

    if row["engine"] == "mujoco_warp":
        return {} if prepare else _warp_check(_model(row), row["batch"])
    mj = _model(row)
    states = models.visited(mj, row["batch"])
    model = jaxsim.load(mj)
    mapped = {"kernel": jax.vmap, "lanes last": jaxsim.vmap, "lanes first": jax.vmap}
    if row["engine"] == "MJX":
        from mujoco import mjx

        put, data = mjx.put_model(mj, impl="jax"), mjx.make_data(mj, impl="jax")

        def at(qpos, qvel, act, warmstart, ctrl):
            given = {"qpos": qpos, "qvel": qvel, "act": act, "qacc_warmstart": warmstart}
            return mjx.forward(put, data.replace(**given, ctrl=ctrl)).qacc

        inputs = (states.qpos, states.qvel, states.act, states.warmstart, states.ctrl)
        args = tuple(jnp.asarray(x, jnp.float32) for x in inputs)
        program = jax.jit(jax.vmap(at)).lower(*args).compile()
    else:
        f = lambda s, u: jaxsim.forward(model, s, u).qacc  # noqa: E731
        f = as_kernel(f) if row["engine"] == "kernel" else f
        f = mapped[row["engine"]](f)
        args = states.batch(model, row["batch"])
        program = jax.jit(f).lower(*args).compile()
    if prepare:
        return {}
    found = models.acceleration_error(np.asarray(program(*args)), states.qacc)
    if row["engine"] == "lanes last":
        found["gradient error"] = _gradient_error(mj)
    return found


def train(row: dict, prepare: bool) -> dict:
    """Steps per second of a training, compilation left out, and the return that it reached."""
    if prepare:
        return {}
    import jaxsim

    result = jaxsim.rl.train(row["model"], row["engine"], overrides=row["set"], seed=0)
    first, last = result.history[0], result.history[-1]
    learned, seconds = last["steps"] - first["steps"], last["seconds"] - first["seconds"]
    return {
        "steps/s": learned / seconds,
        "return": last["eval_return"],
        "seconds": last["seconds"],
    }


def _model(row: dict):
    mj = models.load(row["model"])
    if row.get("iterations"):
        mj.opt.iterations = row["iterations"]
    return mj


def _batch(mj, row: dict, loss: bool = False):
    """The function of a batch, and its arguments; the loss is the final height of what is last."""
    import jax
    import jax.numpy as jnp

    rng, data = np.random.default_rng(0), models.start(mj)
    as_float = lambda x: jnp.asarray(x, jnp.float32)  # noqa: E731
    qvel = as_float(0.01 * rng.standard_normal((row["batch"], mj.nv)))
    ctrls = as_float(models.controls(mj, rng, (row["batch"], row["steps"])))
    if row["engine"] == "MJX":
        from mujoco import mjx

        model, made = mjx.put_model(mj, impl="jax"), mjx.make_data(mj, impl="jax")
        made = made.replace(qpos=as_float(data.qpos))
        state = models.repeated(made, row["batch"]).replace(qvel=qvel)
        step = lambda d, u: (mjx.step(model, d.replace(ctrl=u)), None)  # noqa: E731
        run = lambda d, u: jax.lax.scan(step, d, u)[0]  # noqa: E731
        vmap = jax.vmap
    else:
        import jaxsim

        model = jaxsim.load(mj)
        made = jaxsim.make_state(model).replace(qpos=as_float(data.qpos))
        state = models.repeated(made, row["batch"]).replace(qvel=qvel)
        advance = lambda s, u: jaxsim.step(model, s, u)  # noqa: E731
        advance = jaxsim.checkpoint(advance) if loss else advance
        run = lambda s, u: jax.lax.scan(lambda s, u: (advance(s, u), None), s, u)[0]  # noqa: E731
        vmap = jax.vmap if row["engine"] == "lanes first" else jaxsim.vmap
    if loss:
        return vmap(lambda s, u: jnp.sum(jnp.square(run(s, u).qpos))), (state, ctrls)
    return vmap(run), (state, ctrls)


def _timed(f, args, steps: int, row: dict, prepare: bool) -> dict:
    import common
    import jax

    if row.get("host_loops"):  # XLA's own options
        start = time.perf_counter()
        program = jax.jit(f).lower(*args).compile()
        seconds = time.perf_counter() - start
        run = lambda: jax.block_until_ready(program(*args))  # noqa: E731
    else:
        run, program, seconds = common.compile_for(f, *args)
    if prepare:
        return {"compile s": seconds}
    run()
    samples = []
    for _ in range(row["repetitions"]):
        start = time.perf_counter()
        run()
        samples.append(time.perf_counter() - start)
    memory = jax.devices()[0].memory_stats() or {}
    found = {"steps/s": steps / statistics.median(samples)}
    found["spread %"] = 100 * (max(samples) - min(samples)) / statistics.median(samples)
    found["temporary kB"] = program.memory_analysis().temp_size_in_bytes / row["batch"] / 1e3
    if "peak_bytes_in_use" in memory:
        found["memory MB"] = memory["peak_bytes_in_use"] / 2**20
    return found


def _gradient_error(mj) -> float:
    """Largest difference to the CPU's gradient in float64, relative to its largest element."""
    import jax
    import jax.numpy as jnp

    import jaxsim

    ctrls = models.controls(mj, np.random.default_rng(0), (8,))

    def of(dtype):
        model = jaxsim.load(mj)
        state = jaxsim.make_state(model)
        final = lambda u: jnp.sum(jnp.square(jaxsim.rollout(model, state, u)[0].qpos))  # noqa: E731
        return np.asarray(jax.jit(jax.grad(final))(jnp.asarray(ctrls, dtype)))

    here = of(jnp.float32)
    with jax.enable_x64(True), jax.default_device(jax.devices("cpu")[0]):
        exact = of(jnp.float64)
    return float(np.abs(here - exact).max() / np.abs(exact).max())


def _warp(mj, worlds: int, ncon: int, nefc: int):
    import mujoco_warp as mjw

    data = models.start(mj)
    # Room for twice the contacts and rows that the visited states have.
    room = {"nconmax": max(2 * ncon, 8), "njmax": max(2 * nefc, 16)}
    return mjw.put_model(mj), mjw.put_data(mj, data, nworld=worlds, **room)


def _room(mj) -> tuple[int, int]:
    """Most contacts and rows among states that a rollout visits."""
    import mujoco

    data, ncon, nefc = models.start(mj), 0, 0
    rng = np.random.default_rng(0)
    for _ in range(500):
        data.ctrl[:] = models.controls(mj, rng, ())
        mujoco.mj_step(mj, data)
        ncon, nefc = max(ncon, data.ncon), max(nefc, data.nefc)
    return ncon, nefc


def _warp_rate(mj, row: dict) -> dict:
    import mujoco_warp as mjw
    import warp as wp

    start = time.perf_counter()
    model, data = _warp(mj, row["batch"], *_room(mj))
    mjw.step(model, data)
    wp.synchronize()
    if wp.get_device().is_cuda:
        with wp.ScopedCapture() as capture:
            mjw.step(model, data)
        step = lambda: wp.capture_launch(capture.graph)  # noqa: E731
    else:
        step = lambda: mjw.step(model, data)  # noqa: E731
    step()
    wp.synchronize()
    found, samples = {"compile s": time.perf_counter() - start}, []
    for _ in range(row["repetitions"]):
        start = time.perf_counter()
        for _ in range(row["steps"]):
            step()
        wp.synchronize()
        samples.append(time.perf_counter() - start)
    found["steps/s"] = row["batch"] * row["steps"] / statistics.median(samples)
    return found | {"spread %": 100 * (max(samples) - min(samples)) / statistics.median(samples)}


def _warp_check(mj, count: int) -> dict:
    import mujoco_warp as mjw

    states = models.visited(mj, count)
    model, data = _warp(mj, count, *_room(mj))
    given = {"qpos": states.qpos, "qvel": states.qvel, "ctrl": states.ctrl}
    for name, values in (given | {"qacc_warmstart": states.warmstart}).items():
        getattr(data, name).assign(values.astype(np.float32))
    mjw.forward(model, data)
    return models.acceleration_error(data.qacc.numpy(), states.qacc)


if __name__ == "__main__":
    os.environ.setdefault("XLA_PYTHON_CLIENT_PREALLOCATE", "false")
    main()
