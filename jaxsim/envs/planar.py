"""Common base of hopper and walker2d: running in a plane without falling."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.moment import Moment
from jaxsim.envs.base.start import uniform_start


def forward_velocity(before: dict, now: Moment, dt: Float[Array, ""]) -> Float[Array, ""]:
    """Displacement along x during the step over its duration (m/s)."""
    return (now.qpos[0] - before["x_position"]) / dt


def within(x: Float[Array, "..."], limits: tuple[float, float]) -> Bool[Array, "..."]:
    """Whether numbers lie strictly between two limits; false for NaN."""
    low, high = limits
    return (low < x) & (x < high)


@struct.dataclass(kw_only=True)
class PlanarWalker(Task):
    """A planar robot with qpos = (x, height, pitch, joints); see the tasks for the options."""

    frame_skip: int = static(4)
    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 1e-3
    healthy_reward: float = 1.0
    terminate_when_unhealthy: bool = static(True)
    healthy_z_range: tuple[float, float] = (0.0, jnp.inf)
    healthy_angle_range: tuple[float, float] = (-jnp.inf, jnp.inf)
    reset_noise_scale: float = 5e-3
    exclude_current_positions_from_observation: bool = static(True)

    def start(self, key):
        """Near the pose of the file, at rest."""
        return uniform_start(self.model, key, self.reset_noise_scale)

    def observe(self, now):
        """Positions but x, and velocities."""
        skip = int(self.exclude_current_positions_from_observation)
        return jnp.concatenate([now.qpos[skip:], jnp.clip(now.qvel, -10.0, 10.0)])

    def info(self, now):
        """Where the torso is."""
        return {
            "x_position": now.qpos[0],
            "z_distance_from_origin": now.qpos[1] - self.model.qpos0[1],
        }

    def healthy(self, now: Moment) -> Bool[Array, ""]:
        """Whether the torso is high and upright enough."""
        high = within(now.qpos[1], self.healthy_z_range)
        return high & within(now.qpos[2], self.healthy_angle_range)

    def reward(self, before, now, action):
        """Speed and health, less the effort."""
        x_velocity = forward_velocity(before, now, self.dt)
        forward = self.forward_reward_weight * x_velocity
        survive = self.healthy_reward * self.healthy(now)
        effort = self.ctrl_cost_weight * jnp.sum(action**2)
        return forward + survive - effort, {
            "reward_forward": forward,
            "reward_ctrl": -effort,
            "reward_survive": survive,
            "x_velocity": x_velocity,
        }

    def terminated(self, now):
        """When the robot falls."""
        return ~self.healthy(now) & self.terminate_when_unhealthy
