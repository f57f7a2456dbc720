"""`pendulum`: swing a rod up and hold it."""

import jax
import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.measures import wrapped
from jaxsim.envs.base.start import load_asset, start_from
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Pendulum(Task):
    """Swing a rod up with a motor that is too weak to lift it, and hold it there.

    Observation (3,):

    | index | quantity | unit |
    |---|---|---|
    | 0, 1 | cosine and sine of the angle from the vertical | |
    | 2 | angular velocity | rad/s |

    Action (1,): torque within (-2, 2) N m.

    Reward: `-(angle^2 + 0.1 velocity^2 + 0.001 torque^2)` with the angle within (-pi, pi], all
    before the step.

    Episode: the angle starts uniformly within pi, the velocity within 1 rad/s of zero; never
    terminated; cut after 200 steps of 0.05 s.

    Gymnasium: Pendulum-v1, except that the speed is not limited to 8 rad/s, which the rod hardly
    ever reaches.

    Brax: not there.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("pendulum"))
    frame_skip: int = static(1)

    def start(self, key):
        """At any angle."""
        draw = jax.random.uniform(key, (2,), minval=-1.0, maxval=1.0)
        return start_from(self.model, jnp.pi * draw[:1], draw[1:])

    def observe(self, now):
        """Angle and velocity."""
        return jnp.concatenate([jnp.cos(now.qpos), jnp.sin(now.qpos), now.qvel])

    def info(self, now):
        """What the next reward is about."""
        return {"angle": now.qpos[0], "velocity": now.qvel[0]}

    def reward(self, before, now, action):
        """Closeness to rest at the top."""
        torque = jnp.clip(action[0], -2, 2)
        cost = wrapped(before["angle"]) ** 2 + 0.1 * before["velocity"] ** 2
        return -(cost + 0.001 * torque**2), {}
