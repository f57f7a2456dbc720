"""`humanoid`: walk forward on two legs."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool

from jaxsim.envs.base.env import static
from jaxsim.envs.base.moment import Moment
from jaxsim.envs.base.start import load_asset
from jaxsim.envs.planar import within
from jaxsim.envs.whole_body import WholeBody, contact_cost
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Humanoid(WholeBody):
    """A humanoid of 17 joints walks along x without falling.

    Observation (348,):

    | index | quantity | unit |
    |---|---|---|
    | 0 | height of the torso | m |
    | 1-4 | orientation of the torso, quaternion wxyz | - |
    | 5-7 | angles of the abdomen: z, y, x | rad |
    | 8-11 | angles of the right hip x, z, y and knee | rad |
    | 12-15 | the same of the left leg | rad |
    | 16-18 | angles of the right shoulder 1, 2 and elbow | rad |
    | 19-21 | the same of the left arm | rad |
    | 22-24 | velocity of the torso, world axes | m/s |
    | 25-27 | angular velocity of the torso, axes of the torso | rad/s |
    | 28-44 | angular velocities of the joints, in the order of 5-21 | rad/s |
    | 45-174 | `cinert`: inertia of each of 13 bodies about the centre of mass | kg m^2, kg m, kg |
    | 175-252 | `cvel`: twist of each body about it, (angular, linear) | rad/s, m/s |
    | 253-269 | `qfrc_actuator`: torque of each joint's actuator | N m |
    | 270-347 | `cfrc_ext`: external wrench on each body, (torque, force) | N m, N |

    Positions x and y come first if `exclude_current_positions_from_observation` is false; the last
    four groups are left out if the option `include_..._in_observation` of their name is false.

    Action (17,): torques over the gears (25 to 300 N m), within (-0.4, 0.4), in the order abdomen
    y, z, x, right leg, left leg, right arm, left arm.

    Reward: `forward_reward_weight * dx / dt + healthy_reward * healthy - ctrl_cost_weight *
    |action|^2 - contact cost`, where dx is the displacement of the centre of mass along x during
    the step of dt = 15 ms, and the contact cost is `contact_cost_weight * |wrenches|^2`, clipped
    to `contact_cost_range`. Healthy: the height is within `healthy_z_range`.

    Episode: starts with positions and velocities uniform within `reset_noise_scale` about standing
    at rest; terminated when not healthy, unless `terminate_when_unhealthy` is false; cut after
    1000 steps.

    Differences from Gymnasium's Humanoid-v5: task and model are the same. As there, what is not
    position or velocity is that of the last evaluation of forces, one stage of Runge-Kutta before
    the state. Gymnasium's file solves for the contact forces by 50 sweeps of PGS, which stops
    before the optimum that we find. From Brax: its humanoid touches the floor with the feet only
    and not itself, advances by semi-implicit Euler, scales actions from (-1, 1), has no contact
    cost, and observes other frames and no wrenches.

    Attributes:
      forward_reward_weight: reward for a speed of 1 m/s.
      ctrl_cost_weight: price of the squared action.
      contact_cost_weight: price of the squared wrenches.
      contact_cost_range: what the contact cost is clipped to.
      healthy_reward: reward for each step in health.
      terminate_when_unhealthy: whether falling ends the episode.
      healthy_z_range: where the height may be (m).
      reset_noise_scale: spread of the start.
      exclude_current_positions_from_observation: whether x and y are left out.
      include_cinert_in_observation: whether inertias are observed.
      include_cvel_in_observation: whether twists are observed.
      include_qfrc_actuator_in_observation: whether torques are observed.
      include_cfrc_ext_in_observation: whether wrenches are observed.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("humanoid", rotations="mujoco"))
    forward_reward_weight: float = 1.25
    ctrl_cost_weight: float = 0.1
    contact_cost_weight: float = 5e-7
    contact_cost_range: tuple[float, float] = (-jnp.inf, 10.0)
    healthy_reward: float = 5.0
    terminate_when_unhealthy: bool = static(True)
    healthy_z_range: tuple[float, float] = (1.0, 2.0)

    def info(self, now):
        """Where torso and centre of mass are."""
        return {**super().info(now), "center_of_mass": now.subtree_com[0, :2]}

    def healthy(self, now: Moment) -> Bool[Array, ""]:
        """Whether the torso is high enough."""
        return within(now.qpos[2], self.healthy_z_range)

    def reward(self, before, now, action):
        """Speed and health, less effort and contacts."""
        moved = now.subtree_com[0, :2] - before["center_of_mass"]
        x_velocity, y_velocity = moved / self.dt
        forward = self.forward_reward_weight * x_velocity
        survive = self.healthy_reward * self.healthy(now)
        effort = self.ctrl_cost_weight * jnp.sum(action**2)
        contact = contact_cost(now, self.contact_cost_weight, self.contact_cost_range)
        return forward + survive - effort - contact, {
            "reward_survive": survive,
            "reward_forward": forward,
            "reward_ctrl": -effort,
            "reward_contact": -contact,
            "x_velocity": x_velocity,
            "y_velocity": y_velocity,
        }

    def terminated(self, now):
        """When the humanoid falls."""
        return ~self.healthy(now) & self.terminate_when_unhealthy
