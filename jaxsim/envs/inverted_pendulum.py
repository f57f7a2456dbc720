"""`inverted_pendulum`: balance a pole on a cart."""

import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.start import load_asset, uniform_start
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class InvertedPendulum(Task):
    """Balance a pole by pushing the cart on which it stands.

    Observation (4,):

    | index | quantity | unit |
    |---|---|---|
    | 0 | position of the cart | m |
    | 1 | angle of the pole from the vertical | rad |
    | 2 | velocity of the cart | m/s |
    | 3 | angular velocity of the pole | rad/s |

    Action (1,): force on the cart within (-3, 3), times 100 N.

    Reward: 1 for each step in which the pole stands, 0 for that in which it falls.

    Episode: positions and velocities start uniformly within 0.01 of zero; terminated where the
    angle exceeds 0.2 rad or something is not finite; cut after 1000 steps of 0.04 s.

    Gymnasium: the same as InvertedPendulum-v5 in every respect.

    Brax: its actions are within (-1, 1), and it rewards the step that falls as well.

    Attributes:
      reset_noise_scale: half-width of the start distribution.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("inverted_pendulum"))
    frame_skip: int = static(2)
    reset_noise_scale: float = 0.01

    def start(self, key):
        """Near upright and at rest."""
        return uniform_start(self.model, key, self.reset_noise_scale)

    def observe(self, now):
        """Positions and velocities."""
        return jnp.concatenate([now.qpos, now.qvel])

    def terminated(self, now):
        """The pole has fallen."""
        return ~jnp.isfinite(self.observe(now)).all() | (jnp.abs(now.qpos[1]) > 0.2)

    def reward(self, before, now, action):
        """One while the pole stands."""
        survive = ~self.terminated(now)
        return survive, {"reward_survive": survive}
