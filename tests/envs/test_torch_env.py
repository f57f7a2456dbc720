"""Arrays shared by dlpack; numpy stands in for torch, which speaks the same protocol."""

import sys

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsim.envs  # noqa: F401
from jaxsim.envs.bridges import torch_env


def make(mode="NextStep", n=3):
    return torch_env.TorchVectorEnv(
        "fast", n, from_dlpack=np.from_dlpack, autoreset_mode=mode, max_episode_steps=2
    )


class Tensor:
    """What a torch tensor is to us: dlpack, and derivatives to detach."""

    def __init__(self, value):
        self.value = value

    def detach(self):
        return self.value


@pytest.fixture
def torch(monkeypatch):
    """A module called torch that knows `from_dlpack`."""
    module = type(sys)("torch")
    module.from_dlpack = np.from_dlpack
    monkeypatch.setitem(sys.modules, "torch", module)


def test_memory_is_shared(torch):
    x = jnp.arange(6.0)
    tree = torch_env.to_torch({"x": x, "flags": (x > 2,)})
    assert tree["x"].__array_interface__["data"][0] == x.unsafe_buffer_pointer()
    np.testing.assert_array_equal(tree["flags"][0], [False] * 3 + [True] * 3)


def test_tensors_come_back(torch):
    given = np.arange(3, dtype=np.float32)
    back = torch_env.from_torch({"a": Tensor(given), "b": given})
    assert isinstance(back["a"], jax.Array)
    np.testing.assert_array_equal(back["a"], given)
    np.testing.assert_array_equal(back["b"], given)


def test_what_is_on_several_devices_is_gathered(torch):
    mesh = jax.sharding.Mesh(jax.devices(), ("batch",))
    split = jax.sharding.NamedSharding(mesh, jax.sharding.PartitionSpec("batch"))
    x = jax.device_put(jnp.arange(4.0), split)
    np.testing.assert_array_equal(torch_env.to_torch(x), [0, 1, 2, 3])


def test_without_torch_the_error_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ModuleNotFoundError, match="pip install torch"):
        torch_env.to_torch(jnp.zeros(1))
    with pytest.raises(ModuleNotFoundError, match="pip install torch"):
        torch_env.TorchVectorEnv("fast", 2)


@pytest.mark.parametrize("n", [3, 4])  # four are spread over both devices
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_says_what_the_numpy_environment_says(mode, n):
    ours = make(mode, n)
    plain = gymnasium.make_vec(
        "jaxsim/Fast-v0", num_envs=n, autoreset_mode=mode, max_episode_steps=2
    )
    np.testing.assert_array_equal(ours.reset(seed=4)[0], plain.reset(seed=4)[0])
    for _ in range(5):
        actions = plain.action_space.sample()
        mine, theirs = ours.step(actions), plain.step(actions)
        for x, y in zip(mine[:4], theirs[:4], strict=True):
            np.testing.assert_allclose(x, y, rtol=1e-6)
        np.testing.assert_array_equal(mine[4]["distance"], theirs[4]["distance"])
        ended = (mine[2] | mine[3]) & (mode == "SameStep")
        if mode == "SameStep":
            np.testing.assert_array_equal(mine[4]["_final_obs"], ended)
        for i in np.flatnonzero(ended):
            np.testing.assert_array_equal(mine[4]["final_obs"][i], theirs[4]["final_obs"][i])


def test_the_user_may_restart():
    envs = make("Disabled")
    envs.reset(seed=0)
    for _ in range(2):
        envs.step(np.zeros((3, 1), np.float32))
    with pytest.raises(gymnasium.error.ResetNeeded):
        envs.step(np.zeros((3, 1), np.float32))
    _, info = envs.reset(options={"reset_mask": np.ones(3, bool)})
    assert info["_distance"].all()
    envs.step(np.zeros((3, 1), np.float32))
