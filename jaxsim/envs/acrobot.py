"""`acrobot`: swing two rods up with a motor at the elbow."""

import jax
import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.measures import distance, near_zero
from jaxsim.envs.base.start import load_asset, start_from
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Acrobot(Task):
    """Swing up two rods that hang from a shoulder without a motor, by moving the elbow.

    Observation (6,):

    | index | quantity | unit |
    |---|---|---|
    | 0, 1 | sines of the angles of both rods from the vertical | |
    | 2, 3 | cosines of these angles | |
    | 4 | angular velocity of the shoulder | rad/s |
    | 5 | angular velocity of the elbow | rad/s |

    Action (1,): torque at the elbow within (-1, 1), times 2 N m.

    Reward: 1 within 0.2 m of the target above the shoulder, less outside: `0.1^(d^2)` at a distance
    of d metres from that ball.

    Episode: both angles start uniformly within pi, at rest; never terminated; cut after 1000 steps
    of 0.01 s.

    Gymnasium: not there; its Acrobot-v1 has three discrete actions and another reward. Reward and
    numbers are those of dm_control's acrobot swingup, whose integrator is Runge-Kutta.

    Brax: not there.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("acrobot"))
    frame_skip: int = static(1)

    def start(self, key):
        """At any angles, at rest."""
        qpos = jax.random.uniform(key, (2,), minval=-jnp.pi, maxval=jnp.pi)
        return start_from(self.model, qpos, jnp.zeros(2))

    def observe(self, now):
        """Directions of the rods, and velocities."""
        angles = jnp.cumsum(now.qpos)
        return jnp.concatenate([jnp.sin(angles), jnp.cos(angles), now.qvel])

    def reward(self, before, now, action):
        """Closeness of the tip to the target."""
        angles = jnp.cumsum(now.qpos)
        # The target is where the tip is when both rods, a metre each, stand.
        tip = jnp.stack([jnp.sum(jnp.sin(angles)), jnp.sum(jnp.cos(angles)) - 2])
        away = distance(tip)
        return near_zero(jnp.maximum(away - 0.2, 0), 1), {"distance": away}
