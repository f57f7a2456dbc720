"""`inverted_double_pendulum`: balance two poles on a cart."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.start import load_asset, uniform_start
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class InvertedDoublePendulum(Task):
    """Balance two poles, one on top of the other, by pushing the cart on which they stand.

    Observation (9,):

    | index | quantity | unit |
    |---|---|---|
    | 0 | position of the cart | m |
    | 1, 2 | sines of the angles of the lower pole, and of the upper one relative to it | |
    | 3, 4 | cosines of these angles | |
    | 5 | velocity of the cart, within (-10, 10) | m/s |
    | 6, 7 | angular velocities of the poles, within (-10, 10) | rad/s |
    | 8 | force of the rail's ends on the cart, within (-10, 10) | N |

    Action (1,): force on the cart within (-1, 1), times 500 N.

    Reward: 10 while it stands, minus `0.01 x^2 + (z - 2)^2` with the tip at (x, z), minus
    `0.001 v1^2 + 0.005 v2^2` with the angular velocities of the poles.

    Episode: positions start uniformly within 0.1 of zero, velocities from 0.1 times the normal
    distribution; terminated where the tip is not above 1 m; cut after 1000 steps of 0.05 s.

    Gymnasium: the same as InvertedDoublePendulum-v5 in every respect; as there, force and tip are
    those of the last evaluation of forces.

    Brax: it observes no force, takes two time steps for each action, and starts within 0.01.

    Attributes:
      healthy_reward: reward for standing.
      reset_noise_scale: size of the start distribution.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("inverted_double_pendulum"))
    frame_skip: int = static(5)
    healthy_reward: float = 10.0
    reset_noise_scale: float = 0.1

    def start(self, key):
        """Near upright."""
        return uniform_start(self.model, key, self.reset_noise_scale, normal_velocity=True)

    def observe(self, now):
        """Position, angles, velocities and the rail's force."""
        angles, force = now.qpos[1:], now.qfrc_constraint[:1]
        rates = jnp.clip(jnp.concatenate([now.qvel, force]), -10, 10)
        return jnp.concatenate([now.qpos[:1], jnp.sin(angles), jnp.cos(angles), rates])

    def terminated(self, now):
        """The tip is not above 1 m."""
        return ~(now.site_xpos[0, 2] > 1)

    def reward(self, before, now, action):
        """Standing, less distance from the top and speed."""
        x, _, z = now.site_xpos[0]
        terms = {
            "reward_survive": self.healthy_reward * ~self.terminated(now),
            "distance_penalty": -(0.01 * x**2 + (z - 2) ** 2),
            "velocity_penalty": -(1e-3 * now.qvel[1] ** 2 + 5e-3 * now.qvel[2] ** 2),
        }
        return sum(terms.values()), terms
