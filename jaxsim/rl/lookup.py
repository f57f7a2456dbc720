"""Look-up of algorithms and environments by name, before anything is traced."""

from typing import Any

from jaxsim import envs
from jaxsim.envs.registry.named import named
from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.config import TrainConfig, unknown
from jaxsim.rl.errors import ConfigError

# Each is a module of this package, imported when it is used, with a class of the same name.
ALGORITHMS = ("ppo", "sac", "apg", "shac")


def algorithm_class(algorithm: str | type[Algorithm]) -> type[Any]:
    """The class of an algorithm; `(env, config, devices)` makes an `Algorithm`.

    Args:
      algorithm: one of `ALGORITHMS`, a class, or "module:Class".

    Raises:
      ConfigError: there is no such algorithm.
    """
    if isinstance(algorithm, str) and ":" not in algorithm and algorithm not in ALGORITHMS:
        raise ConfigError(unknown("algorithm", algorithm, algorithm, ALGORITHMS))
    try:
        found = named(_path(algorithm)) if isinstance(algorithm, str) else algorithm
    except ImportError as error:
        raise ConfigError(f"cannot import algorithm {algorithm!r}: {error}") from error
    if not (isinstance(found, type) and issubclass(found, Algorithm)):
        raise ConfigError(f"an algorithm derives from jaxsim.rl.Algorithm, got {algorithm!r}")
    return found


def algorithm_name(algorithm: str | type[Algorithm]) -> str:
    """The name by which `algorithm_class` finds it, also in another process."""
    if isinstance(algorithm, type):
        return f"{algorithm.__module__}:{algorithm.__qualname__}"
    return algorithm


def make_env(env: str | envs.Env, settings: TrainConfig) -> envs.Env:
    """The environment for evaluation: the given one, or one made by name with the options set.

    Raises:
      ConfigError: there is no such environment, it has no such option, or it cannot be used for
        training.
    """
    if not isinstance(env, str):
        return _checked(env)
    try:
        return envs.make(env, **settings.env_options)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(error.args[0]) from error


def _checked(env: Any) -> envs.Env:
    if not isinstance(env, envs.Env):
        raise ConfigError(
            "train takes a name or one environment of jaxsim.envs, which it batches itself, got "
            f"{type(env).__name__}"
        )
    if env.model.qpos0.ndim != 1:
        raise ConfigError(
            "train takes one environment, which it batches itself; this one holds a batch of "
            f"models of shape {env.model.qpos0.shape[:-1]}: wrap one in "
            "jaxsim.envs.wrappers.Randomize for models that differ"
        )
    inner = env
    while isinstance(inner, envs.Wrapper):
        if isinstance(inner, envs.AutoReset):
            raise ConfigError("train restarts episodes itself: give it the env inside AutoReset")
        inner = inner.env
    return env


def _path(algorithm: str) -> str:
    if algorithm in ALGORITHMS:
        return f"jaxsim.rl.{algorithm}:{algorithm.upper()}"
    return algorithm
