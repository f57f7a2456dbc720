"""`cartpole`: swing a pole up from a cart and balance it."""

import jax
import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.measures import near_zero
from jaxsim.envs.base.start import load_asset, start_from
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Cartpole(Task):
    """Swing up a hanging pole by pushing the cart to which it is hinged, and balance it.

    Observation (5,):

    | index | quantity | unit |
    |---|---|---|
    | 0 | position of the cart | m |
    | 1, 2 | cosine and sine of the pole's angle from the vertical | |
    | 3 | velocity of the cart | m/s |
    | 4 | angular velocity of the pole | rad/s |

    Action (1,): force on the cart within (-1, 1), times 10 N.

    Reward: a product of four factors within (0, 1), smooth everywhere: height of the pole
    `(1 + cos) / 2`, cart near the middle `(1 + g(x / 2)) / 2`, weak action
    `(4 + max(0, 1 - action^2)) / 5`, slow pole `(1 + g(velocity / 5)) / 2`, where
    `g(u) = 0.1^(u^2)`.

    Episode: hanging at rest in the middle, up to 0.01 times the normal distribution in all
    positions and velocities; never terminated; cut after 1000 steps of 0.01 s.

    Gymnasium: not there; its CartPole-v1 is another task. Reward and numbers are those of
    dm_control's cartpole swingup, whose integrator is Runge-Kutta, four times slower.

    Brax: not there.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("cartpole"))
    frame_skip: int = static(1)

    def start(self, key):
        """Hanging at rest."""
        noise = 0.01 * jax.random.normal(key, (4,))
        return start_from(self.model, jnp.array([0.0, jnp.pi]) + noise[:2], noise[2:])

    def observe(self, now):
        """Positions and velocities."""
        x, angle = now.qpos
        return jnp.concatenate([jnp.stack([x, jnp.cos(angle), jnp.sin(angle)]), now.qvel])

    def reward(self, before, now, action):
        """Upright, in the middle, with little force and speed."""
        x, angle = now.qpos
        terms = {
            "upright": (1 + jnp.cos(angle)) / 2,
            "centered": (1 + near_zero(x, 2)) / 2,
            "small_control": (4 + jnp.maximum(0, 1 - action[0] ** 2)) / 5,
            "small_velocity": (1 + near_zero(now.qvel[1], 5)) / 2,
        }
        return jnp.prod(jnp.stack(list(terms.values()))), terms
