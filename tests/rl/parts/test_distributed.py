"""Several processes learn what one process with as many devices learns."""

import json
import os
import pathlib
import socket
import subprocess
import sys

import pytest

REPOSITORY = pathlib.Path(__file__).parents[3]

SCRIPT = """
import json, sys
import jax
devices, processes, index, port, settings = json.loads(sys.argv[1])
jax.config.update("jax_num_cpu_devices", devices)
from jaxsim.rl.parts import distributed
from jaxsim.rl import train
if processes > 1:
    distributed.join(f"localhost:{port}", processes, index)
assert len(jax.devices()) == devices * processes
result = train("fast", settings=settings, directory=sys.argv[2] or None)
leaves = jax.tree.leaves(jax.device_get(result.training.learner.params))
history = [{k: v for k, v in row.items() if k != "seconds"} for row in result.history]
print(json.dumps([[x.tobytes().hex() for x in leaves], history]))
"""


def start(settings, devices, processes=1, index=0, port=0, directory=""):
    arguments = json.dumps([devices, processes, index, port, settings])
    paths = [str(REPOSITORY), os.environ.get("PYTHONPATH", "")]
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, arguments, str(directory)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(p for p in paths if p)},
    )


def finish(process):
    out, error = process.communicate(timeout=300)
    assert process.returncode == 0, error
    return json.loads(out.splitlines()[-1])


@pytest.mark.slow
def test_two_processes_are_one_with_two_devices(tiny, tmp_path):
    """To the last bit: the sum of two numbers does not depend on who adds them."""
    with socket.socket() as free:
        free.bind(("localhost", 0))
        port = free.getsockname()[1]
    pair = [start(tiny, 1, 2, index, port, tmp_path / "run") for index in (0, 1)]
    parameters, history = zip(*(finish(process) for process in pair), strict=True)
    expected_parameters, expected_history = finish(start(tiny, 2))
    assert parameters[0] == parameters[1] == expected_parameters
    assert history[0] == history[1] == expected_history
    lines = (tmp_path / "run" / "metrics.jsonl").read_text("utf-8").splitlines()
    assert len(lines) == len(expected_history), "only one of the processes writes"
