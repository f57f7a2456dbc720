"""Steps per second against the size of the batch and against the number of cores.

One process for each number of devices (a CPU has one per core), as JAX fixes it when it starts;
the processes take turns. "efficiency" is the throughput on all devices relative to that of one
times their number; "of best" the throughput relative to the best batch size.
"""

import argparse
import json
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile

import common
import models


def main(arguments=None) -> None:
    options = _options(arguments)
    if options.worker:
        return _work(options)
    samples: dict[tuple[int, int], list[float]] = {}
    for _ in range(options.repetitions):
        for devices in options.devices:
            for batch, seconds in _measure(options, devices).items():
                samples.setdefault((devices, int(batch)), []).append(seconds)
    rows = _rows(options, samples)
    print(common.table(rows))
    common.write(options, __file__, {"rows": rows}, lambda figure: _draw(figure, rows))
    return None


def _options(arguments) -> argparse.Namespace:
    parser = common.parser(__doc__, repetitions=3)
    parser.add_argument("--model", default="humanoid", choices=models.MODELS)
    sizes = [512, 1024, 4096, 16384, 65536]
    parser.add_argument("--batch", nargs="+", type=int, default=sizes, help="environments")
    parser.add_argument("--steps", type=int, default=50, help="steps of a rollout")
    cores = os.cpu_count() or 1
    counts = sorted({1, cores} | {2**i for i in range(cores.bit_length()) if 2**i <= cores})
    parser.add_argument("--devices", nargs="+", type=int, default=counts, help="numbers of devices")
    parser.add_argument("--worker", type=pathlib.Path, help=argparse.SUPPRESS)
    return parser.parse_args(arguments)


def _measure(options, devices: int) -> dict[str, float]:
    """Seconds per step for each batch size, in a process of its own."""
    with tempfile.TemporaryDirectory() as folder:
        result = pathlib.Path(folder) / "times.json"
        command = [sys.executable, __file__, "--worker", str(result), "--model", options.model]
        command += ["--devices", str(devices), "--steps", str(options.steps)]
        command += ["--batch", *map(str, options.batch)]
        subprocess.run(command, check=True)
        return json.loads(result.read_text())


def _work(options) -> None:
    """All batch sizes in turn, in this process."""
    import jax
    import jax.numpy as jnp
    import numpy as np

    common.setup(devices=options.devices[0])
    import jaxsim

    mj = models.load(options.model)
    model = jaxsim.load(mj)
    states, rng = models.visited(mj, 32), np.random.default_rng(0)

    def rollout(batch):
        state, _ = states.batch(model, batch)
        ctrls = jnp.asarray(models.controls(mj, rng, (batch, options.steps)), jnp.float32)
        return lambda: jax.block_until_ready(jaxsim.batch_rollout(model, state, ctrls))

    # A batch at a time many times over: at first both devices' threads may share a core.
    times = common.interleave({str(b): rollout(b) for b in options.batch}, 5, at_least=1)
    result = {b: t.per(int(b) * options.steps).median for b, t in times.items()}
    options.worker.write_text(json.dumps(result))


def _rows(options, samples) -> list[dict]:
    rate = {key: 1 / statistics.median(seconds) for key, seconds in samples.items()}
    rows = []
    for (devices, batch), speed in rate.items():
        best = max(r for (d, _), r in rate.items() if d == devices)
        row = {"model": options.model, "devices": devices, "batch": batch, "steps/s": speed}
        row["of best"] = speed / best
        if (1, batch) in rate:
            row["efficiency"] = speed / (devices * rate[1, batch])
        rows.append(row)
    return rows


def _draw(figure, rows) -> None:
    """One curve for each number of devices."""
    axes = figure.subplots()
    for devices in dict.fromkeys(row["devices"] for row in rows):
        curve = [row for row in rows if row["devices"] == devices]
        axes.plot(
            [r["batch"] for r in curve], [r["steps/s"] for r in curve], "o-", label=f"{devices}"
        )
    axes.set(xscale="log", xlabel="environments", ylabel="steps per second", ylim=(0, None))
    axes.legend(title="devices")


if __name__ == "__main__":
    main()
