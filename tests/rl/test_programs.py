"""The programs of a training run on the device alone."""

import re

import jax
import pytest

from jaxsim import envs
from jaxsim.parallel.devices import device_mesh
from jaxsim.rl import config, programs
from jaxsim.rl.lookup import algorithm_class

# Calls of libraries on the device; what XLA's partitioner reads has no code.
ON_THE_DEVICE = {"Sharding", "SPMDFullToShardShape", "SPMDShardToFullShape", "cu_threefry2x32_ffi"}
HOST = r"stablehlo\.(infeed|outfeed|send|recv)\b"


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_programs_for_a_gpu_ask_nothing_of_the_host(algorithm, tiny):
    """Epochs and evaluations as lowered for CUDA: no callback into Python, nothing received."""
    cls = algorithm_class(algorithm)
    known = {k: v for k, v in tiny.items() if k in cls.Config.__dataclass_fields__}
    env = envs.make("fast")
    trainer = cls(envs.AutoReset(env), config.build(cls.Config, known), 1)
    mesh = device_mesh(jax.devices()[:1])
    template = programs.Start(trainer, 0, mesh).template
    for program in (
        programs.epoch_program(trainer, mesh).trace(template),
        programs.evaluation_program(env, trainer, 0, mesh).trace(template.learner),
    ):
        text = program.lower(lowering_platforms=("cuda",)).as_text()
        called = set(re.findall(r"custom_call @([\w$.]+)", text))
        assert "while" in text
        assert called <= ON_THE_DEVICE
        assert re.search(HOST, text) is None
