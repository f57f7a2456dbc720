"""Environments around environments; each is a record with the inner one in `env`."""

from jaxsim.envs.wrappers.time_limit import TimeLimit
from jaxsim.envs.wrappers.wrapper import Wrapper, extended

__all__ = ["TimeLimit", "Wrapper", "extended"]
