"""The interface of environments and the parts of tasks: starts, steps, measures, divergence."""

from jaxsim.envs.base.env import Env, EnvState, Task, static
from jaxsim.envs.base.solves import Solves

__all__ = ["Env", "EnvState", "Solves", "Task", "static"]
