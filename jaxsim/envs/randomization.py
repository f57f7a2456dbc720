"""Domain randomisation: environments whose physics differs."""

import jax
from jaxtyping import PRNGKeyArray

from jaxsim.envs.base.env import Env
from jaxsim.io import set_const
from jaxsim.model import Model

Range = tuple[float, float]


def randomize(
    env: Env,
    key: PRNGKeyArray,
    *,
    mass: Range | None = (0.8, 1.2),
    friction: Range | None = (0.7, 1.3),
    damping: Range | None = (0.7, 1.3),
    strength: Range | None = (0.9, 1.1),
) -> Env:
    """The environment with random masses, friction, damping and motor strengths.

    Each number is multiplied by its own factor, uniform within the range; None keeps it unchanged.
    For other distributions, write a similar function from an environment to an environment. A
    batch of environments is
    `jaxsim.vmap(randomize, in_axes=(None, 0))(env, keys)`.

    Args:
      env: an environment, wrapped or not.
      key: random key.
      mass: factor of each body's mass and inertia; derived constants follow.
      friction: factor of each geom's friction.
      damping: factor of each degree of freedom's damping.
      strength: factor of each motor's gear.
    """
    keys = jax.random.split(key, 4)
    model = env.model
    if mass is not None:
        model = _scaled(model, keys[0], mass, "body_mass", "body_inertia")
        model = set_const(model)
    if friction is not None:
        model = _scaled(model, keys[1], friction, "geom_friction")
    if damping is not None:
        model = _scaled(model, keys[2], damping, "dof_damping")
    if strength is not None:
        model = _scaled(model, keys[3], strength, "actuator_gear")
    return env.with_model(model)


def _scaled(model: Model, key, bounds: Range, *fields: str) -> Model:
    """The model with rows of some fields multiplied by the same random factors."""
    arrays = {name: getattr(model, name) for name in fields}
    like = arrays[fields[0]]
    factor = jax.random.uniform(key, like.shape[:1], like.dtype, *bounds)
    rows = {n: jax.vmap(lambda f, x: f * x)(factor, x) for n, x in arrays.items()}
    return model.replace(**rows)
