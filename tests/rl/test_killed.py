"""A training whose process is killed at random moments, again and again."""

import subprocess
import sys
import time

import numpy as np
import pytest

TRAINING = """
import hashlib, pathlib, sys
import jax, jaxsim
jaxsim.configure_cpu(2)
from jaxsim.rl import train
directory = pathlib.Path(sys.argv[1])
settings = {
    "total_steps": 65536, "envs": 64, "unroll": 16, "minibatches": 2, "passes": 2,
    "evaluations": 16, "evaluation_episodes": 4, "policy": {"hidden": [8]},
    "value": {"hidden": [8]},
}
resume = (directory / "run.yaml").exists()
training = train("fast", settings=settings, directory=directory, resume=resume).training
is_key = lambda x: jax.dtypes.issubdtype(x.dtype, jax.dtypes.prng_key)
plain = [jax.random.key_data(x) if is_key(x) else x for x in jax.tree.leaves(training)]
leaves = [jax.device_get(x).tobytes() for x in plain]
print(hashlib.sha256(b"".join(leaves)).hexdigest())
"""
KILLS = 20


def begin(directory):
    return subprocess.Popen(
        [sys.executable, "-c", TRAINING, str(directory)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )


@pytest.mark.slow
def test_killed_twenty_times_ends_bit_identical(tmp_path):
    """While it starts, compiles, learns, writes a row or a checkpoint: the same numbers."""
    rng, kills, run = np.random.default_rng(0), 0, 0
    begun = time.monotonic()
    whole = begin(tmp_path / "whole").communicate(timeout=300)[0]
    seconds = time.monotonic() - begun
    assert len(whole.strip()) == 64
    while kills < KILLS:
        process = begin(tmp_path / str(run))
        try:
            ended = process.communicate(timeout=rng.uniform(0, seconds))[0]
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            kills += 1
        else:
            assert ended == whole
            run += 1
    assert begin(tmp_path / str(run)).communicate(timeout=300)[0] == whole
