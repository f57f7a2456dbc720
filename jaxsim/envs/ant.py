"""`ant`: run forward on four legs."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.moment import Moment
from jaxsim.envs.base.start import load_asset, uniform_start
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Ant(Task):
    """A sphere with four legs of two joints runs along x without toppling.

    Observation (105,):

    | index | quantity | unit |
    |---|---|---|
    | 0 | height of the torso | m |
    | 1-4 | orientation of the torso, quaternion wxyz | - |
    | 5-12 | hip, ankle of legs 1 to 4: front left, front right, back left, back right | rad |
    | 13-15 | velocity of the torso, world axes | m/s |
    | 16-18 | angular velocity of the torso, axes of the torso | rad/s |
    | 19-26 | angular velocities of hips and ankles, in the order of 5-12 | rad/s |
    | 27-104 | `cfrc_ext`: external wrench on each of 13 bodies, (torque, force) | N m, N |

    Wrenches are clipped to `contact_force_range`; they are left out if
    `include_cfrc_ext_in_observation` is false. Positions x and y come first if
    `exclude_current_positions_from_observation` is false.

    Action (8,): torques of hip and ankle of leg 4, then 1, 2 and 3, over 150 N m, within (-1, 1).

    Reward: `forward_reward_weight * dx / dt + healthy_reward * healthy - ctrl_cost_weight *
    |action|^2 - contact_cost_weight * |clipped wrenches|^2`, where dx is the displacement of
    `main_body` along x during the step of dt = 50 ms. Healthy: the height is within
    `healthy_z_range` and the state is finite.

    Episode: starts with positions uniform within `reset_noise_scale` about the pose of the file
    (legs straight, falling) and normally distributed velocities of that standard deviation;
    terminated when not healthy, unless `terminate_when_unhealthy` is false; cut after 1000 steps.

    Differences from Gymnasium's Ant-v5: task and model are the same. As there, wrenches and the
    displacement are those of the last evaluation of forces, one stage of Runge-Kutta before the
    state. As MuJoCo's, its Runge-Kutta averages angular velocities; load the model without
    `rotations` for the more accurate one. From Brax: its ant touches the floor with spheres at the
    feet only, advances by semi-implicit Euler, observes no wrenches (27 numbers) and has no contact
    cost.

    Attributes:
      forward_reward_weight: reward for a speed of 1 m/s.
      ctrl_cost_weight: price of the squared action.
      contact_cost_weight: price of the squared wrenches.
      healthy_reward: reward for each step in health.
      main_body: the body, by id or by name, whose speed counts.
      terminate_when_unhealthy: whether toppling ends the episode.
      healthy_z_range: where the height may be (m).
      contact_force_range: what wrenches are clipped to.
      reset_noise_scale: spread of the start.
      exclude_current_positions_from_observation: whether x and y are left out.
      include_cfrc_ext_in_observation: whether wrenches are observed.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("ant", rotations="mujoco"))
    frame_skip: int = static(5)
    forward_reward_weight: float = 1.0
    ctrl_cost_weight: float = 0.5
    contact_cost_weight: float = 5e-4
    healthy_reward: float = 1.0
    main_body: int | str = static(1)
    terminate_when_unhealthy: bool = static(True)
    healthy_z_range: tuple[float, float] = (0.2, 1.0)
    contact_force_range: tuple[float, float] = (-1.0, 1.0)
    reset_noise_scale: float = 0.1
    exclude_current_positions_from_observation: bool = static(True)
    include_cfrc_ext_in_observation: bool = static(True)

    def start(self, key):
        """Near the pose of the file, moving a little."""
        return uniform_start(self.model, key, self.reset_noise_scale, normal_velocity=True)

    def contact_forces(self, now: Moment) -> Float[Array, "nbody 6"]:
        """Clipped wrenches on the bodies, the world first."""
        return jnp.clip(now.cfrc_ext, *self.contact_force_range)

    def observe(self, now):
        """Positions but x and y, velocities, wrenches."""
        skip = 2 * self.exclude_current_positions_from_observation
        parts = [now.qpos[skip:], now.qvel]
        if self.include_cfrc_ext_in_observation:
            parts.append(self.contact_forces(now)[1:].ravel())
        return jnp.concatenate(parts)

    def info(self, now):
        """Where the torso is, and where `main_body` was in the last evaluation."""
        body = self.main_body
        body = self.model.names.id("body", body) if isinstance(body, str) else body
        return {
            "x_position": now.qpos[0],
            "y_position": now.qpos[1],
            "main_body_position": now.xpos[body, :2],
        }

    def healthy(self, now: Moment) -> Bool[Array, ""]:
        """Whether the torso is neither on the floor nor in the air."""
        low, high = self.healthy_z_range
        finite = jnp.all(jnp.isfinite(now.qpos)) & jnp.all(jnp.isfinite(now.qvel))
        return finite & (low <= now.qpos[2]) & (now.qpos[2] <= high)

    def reward(self, before, now, action):
        """Speed and health, less effort and contacts."""
        position = self.info(now)["main_body_position"]
        x_velocity, y_velocity = (position - before["main_body_position"]) / self.dt
        forward = self.forward_reward_weight * x_velocity
        survive = self.healthy_reward * self.healthy(now)
        effort = self.ctrl_cost_weight * jnp.sum(action**2)
        contact = self.contact_cost_weight * jnp.sum(self.contact_forces(now) ** 2)
        return forward + survive - effort - contact, {
            "reward_forward": forward,
            "reward_ctrl": -effort,
            "reward_contact": -contact,
            "reward_survive": survive,
            "x_velocity": x_velocity,
            "y_velocity": y_velocity,
        }

    def terminated(self, now):
        """When the ant topples or jumps."""
        return ~self.healthy(now) & self.terminate_when_unhealthy
