"""`humanoid_standup`: stand up from the floor."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.start import load_asset
from jaxsim.envs.whole_body import WholeBody, contact_cost
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class HumanoidStandup(WholeBody):
    """A humanoid that lies on its back gets its torso as high as it can.

    Observation (348,): the same as that of `humanoid`, with the same options.

    Action (17,): the same as that of `humanoid`: torques over the gears, within (-0.4, 0.4).

    Reward: `uph_cost_weight * z / h + 1 - ctrl_cost_weight * |action|^2 - impact cost`, where z is
    the height of the torso, h = 3 ms the time step of the physics, and the impact cost is
    `impact_cost_weight * |wrenches|^2`, clipped to `impact_cost_range`.

    Episode: starts with positions and velocities uniform within `reset_noise_scale` about lying
    at rest; never terminated; cut after 1000 steps.

    Differences from Gymnasium's HumanoidStandup-v5: task and model are the same, but that ignores
    `uph_cost_weight`. What is said at `humanoid` about stages and PGS holds here too. From Brax:
    its model does not touch itself and advances by semi-implicit Euler, its height counts over dt =
    15 ms instead of 3 ms, it has no impact cost, and observes no wrenches.

    Attributes:
      uph_cost_weight: reward for the height, per metre and time step.
      ctrl_cost_weight: price of the squared action.
      impact_cost_weight: price of the squared wrenches.
      impact_cost_range: what the impact cost is clipped to.
      reset_noise_scale: spread of the start.
      exclude_current_positions_from_observation: whether x and y are left out.
      include_cinert_in_observation: whether inertias are observed.
      include_cvel_in_observation: whether twists are observed.
      include_qfrc_actuator_in_observation: whether torques are observed.
      include_cfrc_ext_in_observation: whether wrenches are observed.
    """

    model: Model = struct.field(
        default_factory=lambda: load_asset("humanoid_standup", rotations="mujoco")
    )
    uph_cost_weight: float = 1.0
    ctrl_cost_weight: float = 0.1
    impact_cost_weight: float = 0.5e-6
    impact_cost_range: tuple[float, float] = (-jnp.inf, 10.0)

    def info(self, now):
        """Where the torso is."""
        return {**super().info(now), "z_distance_from_origin": now.qpos[2] - self.model.qpos0[2]}

    def reward(self, before, now, action):
        """Height, less effort and impacts."""
        height = self.uph_cost_weight * now.qpos[2] / self.model.opt.timestep
        effort = self.ctrl_cost_weight * jnp.sum(action**2)
        impact = contact_cost(now, self.impact_cost_weight, self.impact_cost_range)
        return height + 1 - effort - impact, {
            "reward_linup": height,
            "reward_quadctrl": -effort,
            "reward_impact": -impact,
        }
