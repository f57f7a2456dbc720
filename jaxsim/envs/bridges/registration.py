"""Gymnasium's registry: `half_cheetah` becomes `jaxsim/HalfCheetah-v0`."""

import gymnasium
from gymnasium.envs import registration

from jaxsim.envs import registry

_SINGLE = "jaxsim.envs.bridges.single:GymnasiumEnv"
_VECTOR = "jaxsim.envs.bridges.vector:GymnasiumVectorEnv"


def gymnasium_id(name: str) -> str:
    """The identifier under which Gymnasium knows an environment."""
    return f"jaxsim/{''.join(part[:1].upper() + part[1:] for part in name.split('_'))}-v0"


def register_gymnasium(name: str) -> str:
    """Register an environment with Gymnasium; a repeated call replaces the previous one.

    Args:
      name: name of an environment of `jaxsim.envs`; the bundled ones are already registered.

    Returns:
      Its identifier, for `gymnasium.make` and `gymnasium.make_vec`.
    """
    identifier, limit = gymnasium_id(name), registry.spec(name).max_episode_steps
    if identifier in registration.registry:
        registration.registry[identifier].max_episode_steps = limit
    else:
        gymnasium.register(
            identifier,
            entry_point=_SINGLE,
            vector_entry_point=_VECTOR,
            max_episode_steps=limit,
            kwargs={"env": name},
        )
    return identifier
