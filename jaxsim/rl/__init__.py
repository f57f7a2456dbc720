"""Reinforcement learning on thousands of environments at once.

Example:
  >>> import jaxsim
  >>> result = jaxsim.rl.train("inverted_pendulum", progress=True)
  >>> result.evaluations[-1]["eval_return"]
  >>> action = result.policy(obs)
"""

from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.driver import ALGORITHMS, Result, load_policy, resolve, train
from jaxsim.rl.episode import film_episode
from jaxsim.rl.errors import CheckpointError, ConfigError
from jaxsim.rl.evaluation import Evaluation, evaluate
from jaxsim.rl.networks import Policy

__all__ = [
    "ALGORITHMS",
    "Algorithm",
    "CheckpointError",
    "ConfigError",
    "Evaluation",
    "Policy",
    "Result",
    "evaluate",
    "film_episode",
    "load_policy",
    "resolve",
    "train",
]
