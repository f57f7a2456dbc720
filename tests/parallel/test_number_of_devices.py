"""How many devices share a batch changes no number."""

import pathlib
import subprocess
import sys

import numpy as np
import pytest

PROGRAM = """
import sys
import jax, numpy as np
import jaxsim
from jaxsim.parallel import batch_rollout

jaxsim.configure_cpu(int(sys.argv[1]), lanes=sys.argv[2] == "lanes")
assert jax.device_count() == int(sys.argv[1])
model = jaxsim.load("cartpole")
states = jax.vmap(lambda x: jaxsim.make_state(model).replace(qpos=x))(
    np.linspace(-0.5, 0.5, 34, dtype=np.float32).reshape(17, 2)
)
ctrls = np.linspace(-1, 1, 17 * 20, dtype=np.float32).reshape(17, 20, 1)
np.save(sys.argv[3], batch_rollout(model, states, ctrls).qpos)
"""


@pytest.mark.slow
@pytest.mark.parametrize("how", ["lanes", "XLA"])
def test_one_two_and_eight_devices(how, tmp_path: pathlib.Path):
    found = []
    for devices in (1, 2, 8):
        path = tmp_path / f"{devices}.npy"
        command = [sys.executable, "-c", PROGRAM, str(devices), how, str(path)]
        subprocess.run(command, check=True)
        found.append(np.load(path))
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0, atol=1e-6)
