"""`hopper`: hop forward on one leg."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.start import load_asset
from jaxsim.envs.planar import PlanarWalker, within
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Hopper(PlanarWalker):
    """A planar robot of torso, thigh, leg and foot hops forward without falling.

    Observation (11,), of the state after the step; velocities are clipped to (-10, 10):

    | index | quantity | unit |
    |---|---|---|
    | 0 | height of the torso | m |
    | 1 | pitch of the torso | rad |
    | 2-4 | angles of thigh, leg and foot joint | rad |
    | 5, 6 | velocity of the torso, forward and up | m/s |
    | 7 | angular velocity of the torso | rad/s |
    | 8-10 | angular velocities of thigh, leg and foot joint | rad/s |

    The position x comes first if `exclude_current_positions_from_observation` is false.

    Action (3,): torques of thigh, leg and foot joint over 200 N m, within (-1, 1).

    Reward: `forward_reward_weight * dx / dt + healthy_reward * healthy - ctrl_cost_weight *
    |action|^2`, where dx is the displacement along x during the step of dt = 8 ms. Healthy: the
    height is within `healthy_z_range`, the pitch within `healthy_angle_range`, and every number
    of the state after the height within `healthy_state_range`.

    Episode: starts with positions and velocities uniform within `reset_noise_scale` about standing
    at rest; terminated when not healthy, unless `terminate_when_unhealthy` is false; cut after
    1000 steps.

    Differences from Gymnasium's Hopper-v5: none. From Brax: its hopper touches the floor with the
    foot only, advances by semi-implicit Euler instead of Runge-Kutta, and pays `healthy_reward` in
    the step that falls as well.

    Attributes:
      forward_reward_weight: reward for a speed of 1 m/s.
      ctrl_cost_weight: price of the squared action.
      healthy_reward: reward for each step in health.
      terminate_when_unhealthy: whether falling ends the episode.
      healthy_state_range: where pitch, joint angles and all velocities may be.
      healthy_z_range: where the height may be (m).
      healthy_angle_range: where the pitch may be (rad).
      reset_noise_scale: spread of the start.
      exclude_current_positions_from_observation: whether x is left out.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("hopper"))
    healthy_state_range: tuple[float, float] = (-100.0, 100.0)
    healthy_z_range: tuple[float, float] = (0.7, jnp.inf)
    healthy_angle_range: tuple[float, float] = (-0.2, 0.2)

    def healthy(self, now):
        """Whether the hopper stands, and nothing has got out of hand."""
        rest = jnp.concatenate([now.qpos[2:], now.qvel])
        return super().healthy(now) & jnp.all(within(rest, self.healthy_state_range))
