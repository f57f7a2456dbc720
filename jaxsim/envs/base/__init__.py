"""What an environment is, and what tasks are made of: starts, steps, measures, divergence."""

from jaxsim.envs.base.env import Env, EnvState, Task, static

__all__ = ["Env", "EnvState", "Task", "static"]
