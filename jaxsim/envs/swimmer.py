"""`swimmer`: swim along x with two bends."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.measures import distance
from jaxsim.envs.base.start import load_asset, uniform_start
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Swimmer(Task):
    """Three links in a viscous fluid swim along x by bending.

    Observation (8,), or (10,) with the position:

    | index | quantity | unit |
    |---|---|---|
    | 0 | heading of the front link | rad |
    | 1, 2 | angles of the two bends | rad |
    | 3, 4 | velocity (x, y) of the front link's tip | m/s |
    | 5 | angular velocity of the front link | rad/s |
    | 6, 7 | angular velocities of the two bends | rad/s |

    Action (2,): torques of the two bends within (-1, 1), times 150 N m.

    Reward: velocity of the tip along x, minus 0.0001 times the squares of the action.

    Episode: positions and velocities start uniformly within 0.1 of zero; never terminated; cut
    after 1000 steps of 0.04 s.

    Gymnasium: the same as Swimmer-v5 in every respect.

    Brax: it always observes x and y.

    Attributes:
      forward_reward_weight: weight of the velocity.
      ctrl_cost_weight: weight of the squares of the action.
      reset_noise_scale: half-width of the start distribution.
      exclude_current_positions_from_observation: leave x and y out of the observation; otherwise
        they are its first two entries.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("swimmer"))
    frame_skip: int = static(4)
    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 1e-4
    reset_noise_scale: float = 0.1
    exclude_current_positions_from_observation: bool = static(True)

    def start(self, key):
        """Near straight and at rest."""
        return uniform_start(self.model, key, self.reset_noise_scale)

    def observe(self, now):
        """Positions, perhaps without x and y, and velocities."""
        skipped = 2 if self.exclude_current_positions_from_observation else 0
        return jnp.concatenate([now.qpos[skipped:], now.qvel])

    def info(self, now):
        """Where the tip is, for its velocity."""
        return {"position": now.qpos[:2]}

    def reward(self, before, now, action):
        """Progress along x, less effort."""
        position = now.qpos[:2]
        velocity = (position - before["position"]) / self.dt
        forward = self.forward_reward_weight * velocity[0]
        effort = self.ctrl_cost_weight * jnp.sum(action**2)
        return forward - effort, {
            "reward_forward": forward,
            "reward_ctrl": -effort,
            "x_position": position[0],
            "y_position": position[1],
            "distance_from_origin": distance(position),
            "x_velocity": velocity[0],
            "y_velocity": velocity[1],
        }
