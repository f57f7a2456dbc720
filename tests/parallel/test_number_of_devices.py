"""How many devices share a batch changes no number."""

import pathlib
import subprocess
import sys

import numpy as np
import pytest

SIMULATING = """
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


LEARNING = """
import sys
import jax, numpy as np
import jaxsim
from jaxsim import envs
from jaxsim.parallel.devices import EVERYWHERE, SPLIT, device_mesh, parallel
from jaxsim.rl import ppo

jaxsim.configure_cpu(int(sys.argv[1]), lanes=False)
assert jax.device_count() == int(sys.argv[1])
settings = ppo.Config(envs=64, unroll=4, minibatches=1)
trainer = ppo.PPO(envs.AutoReset(envs.make("fast")), settings, jax.device_count())
learner = trainer.init(jax.random.key(0))
obs = jax.random.normal(jax.random.key(1), (64, 1))
old = trainer.network.apply(learner.params["policy"], obs)
action = old.sample(jax.random.key(2))
advantage = np.sin(7 * obs[:, 0])
samples = ppo.Sample(obs, action, old, old.log_prob(action), advantage, advantage)

def learn(learner, samples):
    for _ in range(3):
        learner, losses = trainer.update(learner, samples)
    seen = trainer.end_epoch(learner, samples.obs, learner.key).obs
    return learner.params, seen, losses

mesh = device_mesh()
found = parallel(learn, mesh, (EVERYWHERE, SPLIT), EVERYWHERE)(learner, samples)
np.save(sys.argv[3], np.concatenate([np.ravel(x) for x in jax.tree.leaves(found)]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("program", "how"), [(SIMULATING, "lanes"), (SIMULATING, "XLA"), (LEARNING, "XLA")]
)
def test_one_two_and_eight_devices(program, how, tmp_path: pathlib.Path):
    found = []
    for devices in (1, 2, 8):
        path = tmp_path / f"{devices}.npy"
        command = [sys.executable, "-c", program, str(devices), how, str(path)]
        subprocess.run(command, check=True)
        found.append(np.load(path))
    for other in found[1:]:
        np.testing.assert_allclose(other, found[0], rtol=0, atol=1e-6)
