"""`quadruped`: a robot dog follows velocity commands on flat ground."""

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float, PRNGKeyArray

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.moment import Moment
from jaxsim.envs.base.start import load_asset, start_from, uniform
from jaxsim.model import Model
from jaxsim.spatial import quat_from_axis_angle, quat_inv_rotate


@struct.dataclass(kw_only=True)
class Quadruped(Task):
    """A four-legged robot of 12 kg walks and turns as it is told; commands change on the way.

    Observation (48,), of the state after the step:

    | index | quantity | unit |
    |---|---|---|
    | 0-2 | velocity of the trunk, its own axes | m/s |
    | 3-5 | angular velocity of the trunk, its own axes | rad/s |
    | 6-8 | direction of gravity in the trunk's axes, (0, 0, -1) when level | - |
    | 9-11 | command: velocity forward, to the left, and turning rate to the left | m/s, rad/s |
    | 12-23 | abduction, hip, knee of front left, front right, hind left, hind right | rad |
    | 24-35 | angular velocities of the same | rad/s |
    | 36-47 | last action | - |

    Action (12,): targets of the position servos of the same joints over `action_scale`, within
    (-1, 1); zero is standing.

    Reward: `exp(-|v - v_command|^2 / tracking_width)` for the horizontal velocity in the trunk's
    axes, plus half of the same for the turning rate, minus `bounce_cost_weight * vertical velocity
    squared`, `sway_cost_weight * |roll and pitch rate|^2`, `effort_cost_weight * |torques|^2` and
    `jerk_cost_weight * |change of the action|^2`.

    Episode: starts standing in a random direction, joints and velocities uniform within
    `reset_noise_scale` about rest; commands are uniform within `command_range` and are drawn again
    every `command_period` seconds; terminated when the trunk is lower than `min_height` or tilted
    by more than 60 degrees; cut after 1000 steps of 20 ms.

    Differences from Gymnasium and Brax: neither has this task.

    Attributes:
      command_range: largest command (m/s, m/s, rad/s).
      command_period: how long a command holds (s).
      action_scale: servo target of an action of 1 (rad).
      tracking_width: squared error at which the reward for tracking falls to 1/e.
      bounce_cost_weight: price of squared vertical velocity.
      sway_cost_weight: price of squared roll and pitch rates.
      effort_cost_weight: price of squared torques.
      jerk_cost_weight: price of the squared change of the action.
      min_height: the trunk's lowest height (m).
      reset_noise_scale: spread of the start.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("quadruped"))
    frame_skip: int = static(5)
    command_range: tuple[float, float, float] = (1.0, 0.5, 1.0)
    command_period: float = 5.0
    action_scale: float = 0.5
    tracking_width: float = 0.25
    bounce_cost_weight: float = 0.5
    sway_cost_weight: float = 0.02
    effort_cost_weight: float = 1e-4
    jerk_cost_weight: float = 0.01
    min_height: float = 0.15
    reset_noise_scale: float = 0.05

    def start(self, key):
        """Standing, facing anywhere."""
        turn_key, joint_key, vel_key = jax.random.split(key, 3)
        turn = jax.random.uniform(turn_key, minval=-np.pi, maxval=np.pi)
        heading = quat_from_axis_angle(jnp.asarray([0.0, 0.0, 1.0]), turn)
        base, joints = self.model.qpos0[:3], self.model.qpos0[7:]
        joints = joints + uniform(joint_key, len(joints), self.reset_noise_scale)
        qvel = uniform(vel_key, self.model.nv, self.reset_noise_scale)
        return start_from(self.model, jnp.concatenate([base, heading, joints]), qvel)

    def draw(self, key):
        """What the commands of an episode come from."""
        return {"command_key": jax.random.key_data(key)}

    def command(self, key: PRNGKeyArray) -> Float[Array, "3"]:
        """A random command."""
        return jnp.stack(self.command_range) * uniform(key, 3, 1.0)

    def info(self, now):
        """The command that holds from now on, and the action."""
        key = jax.random.wrap_key_data(now.before["command_key"])
        # The margin keeps sums of time steps from falling short of a multiple of the period.
        count = jnp.floor(now.state.time / self.command_period + 1e-3).astype(jnp.uint32)
        return {"command": self.command(jax.random.fold_in(key, count)), "action": now.action}

    def control(self, action):
        """Servo targets."""
        return self.action_scale * jnp.clip(action, -1.0, 1.0)

    def trunk(self, now: Moment) -> tuple[Array, Array, Array]:
        """Velocity, angular velocity and direction of gravity in the trunk's axes."""
        quat, down = now.qpos[3:7], jnp.asarray([0.0, 0.0, -1.0], now.qpos.dtype)
        return quat_inv_rotate(quat, now.qvel[:3]), now.qvel[3:6], quat_inv_rotate(quat, down)

    def observe(self, now):
        """What sensors and an estimator of the velocity would tell, the command, the action."""
        command, joints = self.info(now)["command"], now.qpos[7:] - self.model.qpos0[7:]
        return jnp.concatenate([*self.trunk(now), command, joints, now.qvel[6:], now.action])

    def reward(self, before, now, action):
        """Tracking, less the costs."""
        velocity, rate, _ = self.trunk(now)
        error = jnp.concatenate([velocity[:2], rate[2:]]) - before["command"]
        gains = {
            "reward_velocity": jnp.exp(-jnp.sum(error[:2] ** 2) / self.tracking_width),
            "reward_turning": 0.5 * jnp.exp(-(error[2] ** 2) / self.tracking_width),
            "reward_bounce": -self.bounce_cost_weight * velocity[2] ** 2,
            "reward_sway": -self.sway_cost_weight * jnp.sum(rate[:2] ** 2),
            "reward_effort": -self.effort_cost_weight * jnp.sum(now.qfrc_actuator[6:] ** 2),
            "reward_jerk": -self.jerk_cost_weight * jnp.sum((action - before["action"]) ** 2),
        }
        return sum(gains.values()), gains

    def terminated(self, now):
        """When the robot falls."""
        upright = (self.trunk(now)[2][2] < -0.5) & (now.qpos[2] >= self.min_height)
        return ~upright

    def _action_bound(self, column, unlimited):
        """Actions are relative to `action_scale`."""
        return np.full(self.action_size, 2 * column - 1, self.model.qpos0.dtype)
