"""`half_cheetah`: run forward on a front and a back leg, in a plane."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.start import load_asset, uniform_start
from jaxsim.envs.planar import forward_velocity
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class HalfCheetah(Task):
    """A planar robot of a torso with head, a back and a front leg runs as fast as it can.

    Observation (17,), of the state after the step:

    | index | quantity | unit |
    |---|---|---|
    | 0 | height of the torso, 0 where it starts | m |
    | 1 | pitch of the torso | rad |
    | 2-4 | angles of the back thigh, shin and foot | rad |
    | 5-7 | angles of the front thigh, shin and foot | rad |
    | 8, 9 | velocity of the torso, forward and up | m/s |
    | 10 | angular velocity of the torso | rad/s |
    | 11-13 | angular velocities of the back thigh, shin and foot | rad/s |
    | 14-16 | angular velocities of the front thigh, shin and foot | rad/s |

    The position x comes first if `exclude_current_positions_from_observation` is false.

    Action (6,): torques of the back thigh, shin and foot over 120, 90 and 60 N m, and of the front
    ones over 120, 60 and 30 N m, within (-1, 1).

    Reward: `forward_reward_weight * dx / dt - ctrl_cost_weight * |action|^2`, where dx is the
    displacement along x during the step of dt = 50 ms.

    Episode: starts with positions uniform within `reset_noise_scale` about the pose of the file
    and normally distributed velocities of that standard deviation; never terminated; cut after
    1000 steps.

    Differences from Gymnasium's HalfCheetah-v5: none. From Brax: in its model only the head, the
    thighs and the feet touch the floor, and the solver takes at most 4 iterations; the task is the
    same.

    Attributes:
      forward_reward_weight: reward for a speed of 1 m/s.
      ctrl_cost_weight: price of the squared action.
      reset_noise_scale: spread of the start.
      exclude_current_positions_from_observation: whether x is left out.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("half_cheetah"))
    frame_skip: int = static(5)
    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 0.1
    reset_noise_scale: float = 0.1
    exclude_current_positions_from_observation: bool = static(True)

    def start(self, key):
        """Near the pose of the file, moving a little."""
        return uniform_start(self.model, key, self.reset_noise_scale, normal_velocity=True)

    def observe(self, now):
        """Positions but x, and velocities."""
        skip = int(self.exclude_current_positions_from_observation)
        return jnp.concatenate([now.qpos[skip:], now.qvel])

    def info(self, now):
        """Where the torso is."""
        return {"x_position": now.qpos[0]}

    def reward(self, before, now, action):
        """Speed, less the effort."""
        x_velocity = forward_velocity(before, now, self.dt)
        forward = self.forward_reward_weight * x_velocity
        effort = self.ctrl_cost_weight * jnp.sum(action**2)
        return forward - effort, {
            "reward_forward": forward,
            "reward_ctrl": -effort,
            "x_velocity": x_velocity,
        }
