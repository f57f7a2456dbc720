"""Arrays shared with torch, or another library that supports dlpack, without a copy.

Example:
  >>> from jaxsim.envs.bridges.torch_env import TorchVectorEnv
  >>> envs = TorchVectorEnv("ant", num_envs=4096)
  >>> obs, _ = envs.reset(seed=0)                  # a torch.Tensor on JAX's device
  >>> obs, reward, terminated, truncated, infos = envs.step(policy(obs))
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.envs.base.env import Env
from jaxsim.envs.bridges import autoreset
from jaxsim.envs.bridges.batch import Batch
from jaxsim.envs.bridges.spaces import public_info
from jaxsim.envs.bridges.vector import GymnasiumVectorEnv
from jaxsim.parallel.devices import SPLIT, shardings


def to_torch(tree: Any) -> Any:
    """JAX arrays as torch tensors that share their memory; do not write into them.

    Args:
      tree: a pytree of arrays; arrays on several devices are gathered first.

    Raises:
      ModuleNotFoundError: torch is not installed.
    """
    return shared(tree, torch_from_dlpack())


def from_torch(tree: Any) -> Any:
    """Tensors, or other arrays that support dlpack, as JAX arrays that share their memory.

    Args:
      tree: a pytree of them; tensors are detached from torch's graph.
    """
    detach = lambda x: x.detach() if hasattr(x, "detach") else x  # noqa: E731
    return jax.tree.map(lambda x: jnp.from_dlpack(detach(x)), tree)


def shared(tree: Any, from_dlpack: Callable[[Any], Any]) -> Any:
    """The arrays of a tree, converted by another library's `from_dlpack`."""
    return jax.tree.map(lambda x: from_dlpack(_on_one_device(x)), tree)


def torch_from_dlpack() -> Callable[[Any], Any]:
    """`torch.from_dlpack`, or an error that says how to install torch."""
    try:
        import torch  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        raise ModuleNotFoundError(
            "this bridge needs torch, which jaxsim does not install: pip install torch"
        ) from error
    return torch.from_dlpack


class TorchVectorEnv(GymnasiumVectorEnv):
    """The vector environment with tensors as arguments and results, without copies to the host.

    Otherwise it is like `GymnasiumVectorEnv`. With SAME_STEP, every step returns
    `infos["final_obs"]` for all environments, valid where `infos["_final_obs"]` is true.
    """

    def __init__(
        self,
        env: Env | str,
        num_envs: int = 1,
        *,
        from_dlpack: Callable[[Any], Any] | None = None,
        **options: Any,
    ):
        """Wrap an environment, or make one.

        Args:
          env: an environment, or the name of a registered one.
          num_envs: number of environments.
          from_dlpack: function that makes an array of another library; by default that of torch.
          **options: arguments of `GymnasiumVectorEnv`.

        Raises:
          ModuleNotFoundError: torch is not installed, and `from_dlpack` is not given.
        """
        self._from_dlpack = from_dlpack or torch_from_dlpack()
        super().__init__(env, num_envs, **options)

    def _taken(self, actions: Any) -> jax.Array:
        # An array of another library is on one device; the environments may be on several. Its
        # parts are copied, because the caller may overwrite the tensor while the step still runs.
        return jax.device_put(from_torch(actions), shardings(self._mesh, SPLIT))

    def _started(self, fresh: Batch, mask: np.ndarray):
        self._done = self._done & ~mask
        info = public_info(fresh.states)
        given = jnp.asarray(mask)
        infos = info | {f"_{name}": given for name in info}
        return shared((fresh.states.obs, infos), self._from_dlpack)

    def _advance(self, actions: Any):
        program = autoreset.compiled_step(self._placed(), self._mesh, self.autoreset_mode)
        self._batch, outcome = program(self._batch, actions, self._done)
        done = outcome.terminated | outcome.truncated
        infos = _masked(outcome.info, jnp.ones_like(done))
        self._done = done
        if outcome.final_obs is not None:
            self._done = jnp.zeros_like(done)
            final = _masked(outcome.final_info, done)
            infos |= _masked({"final_obs": outcome.final_obs, "final_info": final}, done)
        flags = outcome.terminated, outcome.truncated
        return shared((outcome.obs, outcome.reward, *flags, infos), self._from_dlpack)


def _masked(info: dict[str, Any], mask: jax.Array) -> dict[str, Any]:
    return info | {f"_{name}": mask for name in info}


def _on_one_device(x):
    x = jnp.asarray(x)
    if len(x.sharding.device_set) == 1:
        return x
    return jax.device_put(x, min(x.sharding.device_set, key=lambda device: device.id))
