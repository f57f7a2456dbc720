"""Reading a run from its directory.

A run may come from somebody else, and may name code, "module:Class", for its environment or its
algorithm. Such code is imported only if the caller names it, too.
"""

import pathlib
from collections.abc import Mapping
from typing import Any

import jax

from jaxsim import envs
from jaxsim.rl import config
from jaxsim.rl.algorithm import Algorithm
from jaxsim.rl.checkpoint import Checkpoints
from jaxsim.rl.errors import CheckpointError, ConfigError
from jaxsim.rl.lookup import algorithm_class, algorithm_name, make_env
from jaxsim.rl.networks import Policy
from jaxsim.rl.runs.directory import read_run


def load_policy(
    directory: str | pathlib.Path,
    env: envs.Env | str | None = None,
    algorithm: str | type[Algorithm] | None = None,
) -> Policy:
    """The policy in the newest readable checkpoint of a run.

    Args:
      directory: directory of the run.
      env: the environment, if it was not made from a name of `jaxsim.envs.names()`.
      algorithm: the algorithm, if it is not one of `ALGORITHMS`.

    Raises:
      CheckpointError: there is no usable checkpoint, it belongs to another environment, the
        environment is unknown, or the run names code that the caller does not name.
    """
    run = read_run(directory)
    if env is None or isinstance(env, str):
        env = run_env(run, env, algorithm)
    cls, settings = stored_settings(run, algorithm)
    made = cls(envs.AutoReset(env), settings)
    template = jax.eval_shape(lambda key: made.policy(made.init(key)), jax.random.key(0))
    here = jax.sharding.SingleDeviceSharding(jax.devices()[0])
    template = jax.tree.map(
        lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=here), template
    )
    store = Checkpoints(directory, read_only=True)
    try:
        return store.restore_policy(template)
    finally:
        store.close()


def run_env(
    run: Mapping[str, Any],
    env: str | None = None,
    algorithm: str | type[Algorithm] | None = None,
) -> envs.Env:
    """The environment of a run that was read from a directory; arguments as for `load_policy`.

    Raises:
      CheckpointError: it was trained in an environment without a name, or in one whose code the
        caller does not name.
    """
    name = run["env"] if env is None else env
    if name is None:
        raise CheckpointError("this run was trained in an environment without a name; pass env")
    _check_code("env", run["env"], env)
    return make_env(name, stored_settings(run, algorithm)[1])


def stored_settings(
    run: Mapping[str, Any], algorithm: str | type[Algorithm] | None = None
) -> tuple[type[Any], config.TrainConfig]:
    """The algorithm of a run and its settings; arguments as for `load_policy`.

    Raises:
      CheckpointError: the algorithm is code that the caller does not name, or the settings are
        none of its settings.
    """
    _check_code("algorithm", run["algorithm"], algorithm and algorithm_name(algorithm))
    try:
        cls = algorithm_class(run["algorithm"] if algorithm is None else algorithm)
        return cls, config.build(cls.Config, run["settings"])
    except ConfigError as error:
        raise CheckpointError(f"the settings of this run are damaged: {error}") from error


def _check_code(what: str, stored: str | None, named: str | None) -> None:
    """Raise if a run names code that is not jaxsim's own and not named by the caller."""
    if named is not None and stored not in (None, named):
        raise CheckpointError(f"the {what} of this run is {stored!r}, not {named!r}")
    if named is None and stored is not None and ":" in stored:
        raise CheckpointError(
            f"the {what} of this run is {stored!r}, code that is imported only if you name it too: "
            f"{what}={stored!r}, or --{what} {stored}, if you trust it"
        )
