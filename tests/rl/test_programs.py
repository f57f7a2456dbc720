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
def test_an_epoch_for_a_gpu_asks_nothing_of_the_host(algorithm, tiny):
    """As lowered for CUDA: no callback into Python, nothing sent or received."""
    cls = algorithm_class(algorithm)
    known = {k: v for k, v in tiny.items() if k in cls.Config.__dataclass_fields__}
    trainer = cls(envs.AutoReset(envs.make("fast")), config.build(cls.Config, known), 1)
    mesh = device_mesh(jax.devices()[:1])
    template = programs.Start(trainer, 0, mesh).template
    epoch = programs.epoch_program(trainer, mesh).trace(template)
    text = epoch.lower(lowering_platforms=("cuda",)).as_text()
    called = set(re.findall(r"custom_call @([\w$.]+)", text))
    assert "while" in text
    assert called <= ON_THE_DEVICE
    assert re.search(HOST, text) is None
