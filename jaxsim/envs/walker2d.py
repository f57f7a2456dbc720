"""`walker2d`: walk forward on two legs, in a plane."""

from flax import struct

from jaxsim.envs.base.start import load_asset
from jaxsim.envs.planar import PlanarWalker
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Walker2d(PlanarWalker):
    """A planar robot of a torso and two legs walks forward without falling.

    Observation (17,), of the state after the step; velocities are clipped to (-10, 10):

    | index | quantity | unit |
    |---|---|---|
    | 0 | height of the torso | m |
    | 1 | pitch of the torso | rad |
    | 2-4 | angles of the right thigh, leg and foot joint | rad |
    | 5-7 | angles of the left thigh, leg and foot joint | rad |
    | 8, 9 | velocity of the torso, forward and up | m/s |
    | 10 | angular velocity of the torso | rad/s |
    | 11-13 | angular velocities of the right thigh, leg and foot joint | rad/s |
    | 14-16 | angular velocities of the left thigh, leg and foot joint | rad/s |

    The position x comes first if `exclude_current_positions_from_observation` is false.

    Action (6,): torques of the right thigh, leg and foot joint, then the left ones, over 100 N m,
    within (-1, 1).

    Reward: `forward_reward_weight * dx / dt + healthy_reward * healthy - ctrl_cost_weight *
    |action|^2`, where dx is the displacement along x during the step of dt = 8 ms. Healthy: the
    height is within `healthy_z_range` and the pitch within `healthy_angle_range`.

    Episode: starts with positions and velocities uniform within `reset_noise_scale` about standing
    at rest; terminated when not healthy, unless `terminate_when_unhealthy` is false; cut after
    1000 steps.

    Differences from Gymnasium's Walker2d-v5: none; the friction of both feet is 1.9. From Brax: its
    walker touches the floor with the feet only and their friction is 0.9 and 1.9, it advances by
    semi-implicit Euler instead of Runge-Kutta, and pays `healthy_reward` in the step that falls as
    well.

    Attributes:
      forward_reward_weight: reward for a speed of 1 m/s.
      ctrl_cost_weight: price of the squared action.
      healthy_reward: reward for each step in health.
      terminate_when_unhealthy: whether falling ends the episode.
      healthy_z_range: where the height may be (m).
      healthy_angle_range: where the pitch may be (rad).
      reset_noise_scale: spread of the start.
      exclude_current_positions_from_observation: whether x is left out.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("walker2d"))
    healthy_z_range: tuple[float, float] = (0.8, 2.0)
    healthy_angle_range: tuple[float, float] = (-1.0, 1.0)
