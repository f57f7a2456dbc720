"""Wrappers: environments that modify another one, which is their field `env`.

They nest in any order, except that `AutoReset` is the outermost.
"""

from jaxsim.envs.wrappers.action_repeat import ActionRepeat
from jaxsim.envs.wrappers.auto_reset import AutoReset
from jaxsim.envs.wrappers.delay import Delay
from jaxsim.envs.wrappers.history import History
from jaxsim.envs.wrappers.noise import Noise
from jaxsim.envs.wrappers.normalize import NormalizeObservation, NormalizeReward
from jaxsim.envs.wrappers.randomize import Randomize
from jaxsim.envs.wrappers.time_limit import TimeLimit
from jaxsim.envs.wrappers.wrapper import Wrapper, extended

__all__ = [
    "ActionRepeat",
    "AutoReset",
    "Delay",
    "History",
    "Noise",
    "NormalizeObservation",
    "NormalizeReward",
    "Randomize",
    "TimeLimit",
    "Wrapper",
    "extended",
]
