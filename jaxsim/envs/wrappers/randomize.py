"""`Randomize`: random physics in every episode."""

from collections.abc import Callable
from typing import Any

import jax
from flax import struct

from jaxsim.envs.base.env import Env, EnvState
from jaxsim.envs.randomization import randomize
from jaxsim.envs.wrappers.wrapper import Wrapper, extended


@struct.dataclass
class Randomize(Wrapper):
    """Draws new numbers for the inner environment at every reset.

    Leaves that differ from the nominal environment are stored in `info["drawn"]` by name, so `draw`
    should not copy leaves that it does not change. If each environment can keep its numbers, map
    over environments instead, which costs nothing at a reset:

      envs = jaxsim.vmap(randomize, in_axes=(None, 0))(env, keys)
      states = jaxsim.vmap(lambda env, *args: env.step(*args))(envs, states, actions)

    Attributes:
      draw: function from an environment and a key to an environment of the same structure.
    """

    draw: Callable[[Env, Any], Env] = struct.field(pytree_node=False, default=randomize)

    def reset(self, key) -> EnvState:
        """Start an episode with new numbers."""
        key, draw_key = jax.random.split(key)
        env = self.draw(self.env, draw_key)
        return extended(env.reset(key), drawn=_changes(self.env, env))

    def step(self, state, action) -> EnvState:
        """Act for one step in the environment of this episode."""
        return _with(self.env, state.info["drawn"]).step(state, action)


def _changes(before: Env, after: Env) -> dict[str, Any]:
    """Leaves of `after` that are other objects than those of `before`, by name."""
    old, new = jax.tree.leaves_with_path(before), jax.tree.leaves(after)
    return {jax.tree_util.keystr(p): y for (p, x), y in zip(old, new, strict=True) if x is not y}


def _with(env: Env, changes: dict[str, Any]) -> Env:
    """The environment with some leaves replaced."""
    return jax.tree_util.tree_map_with_path(
        lambda path, x: changes.get(jax.tree_util.keystr(path), x), env
    )
