"""Environments for reinforcement learning: `make`, `register`, and the parts of environments.

Example:
  >>> import jax, jaxsim
  >>> env = jaxsim.envs.make("reacher")
  >>> keys = jax.random.split(jax.random.key(0), 8)
  >>> states = jax.jit(jaxsim.vmap(env.reset))(keys)
  >>> states = jax.jit(jaxsim.vmap(env.step))(states, jax.numpy.zeros((8, env.action_size)))
"""

from jaxsim.envs import bridges, registry
from jaxsim.envs.base import Env, EnvState, Task, static
from jaxsim.envs.base.moment import Moment
from jaxsim.envs.base.start import load_asset, start_from, uniform, uniform_start
from jaxsim.envs.randomization import randomize
from jaxsim.envs.registry import Spec, make, names, register, spec
from jaxsim.envs.wrappers import AutoReset, TimeLimit, Wrapper, extended

__all__ = [
    "AutoReset",
    "Env",
    "EnvState",
    "Moment",
    "Spec",
    "Task",
    "TimeLimit",
    "Wrapper",
    "extended",
    "load_asset",
    "make",
    "names",
    "randomize",
    "register",
    "spec",
    "start_from",
    "static",
    "uniform",
    "uniform_start",
]

registry.on_register(bridges.register_gymnasium)
