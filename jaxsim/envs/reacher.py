"""`reacher`: bring the end of an arm to a target."""

import jax
import jax.numpy as jnp
from flax import struct

from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.measures import distance
from jaxsim.envs.base.start import load_asset, start_from, uniform
from jaxsim.model import Model


@struct.dataclass(kw_only=True)
class Reacher(Task):
    """Bring the tip of an arm with two joints to a random point of the plane.

    Observation (10,):

    | index | quantity | unit |
    |---|---|---|
    | 0, 1 | cosines of the angles of shoulder and elbow | |
    | 2, 3 | sines of these angles | |
    | 4, 5 | position (x, y) of the target | m |
    | 6, 7 | angular velocities of shoulder and elbow | rad/s |
    | 8, 9 | from the target to the fingertip (x, y) | m |

    Action (2,): torques at shoulder and elbow within (-1, 1), times 200 N m.

    Reward: minus the distance from fingertip to target, minus the squares of the action.

    Episode: angles start uniformly within 0.1 and their velocities within 0.005 of zero, the target
    uniformly in a disc of 0.2 m; never terminated; cut after 50 steps of 0.02 s.

    Gymnasium: the same as Reacher-v5 in every respect; as there, the vector to the target is that
    of the last evaluation of forces.

    Brax: it observes the velocity of the fingertip instead of the angular velocities and three
    components of the vector, and draws the target nearer to the middle.

    Attributes:
      reward_dist_weight: weight of the distance.
      reward_control_weight: weight of the squares of the action.
    """

    model: Model = struct.field(default_factory=lambda: load_asset("reacher"))
    frame_skip: int = static(2)
    reward_dist_weight: float = 1.0
    reward_control_weight: float = 1.0

    def start(self, key):
        """An arm nearly straight, a target within reach."""
        angles, speeds, radius, turn = jax.random.split(key, 4)
        # The area within a radius grows with its square.
        r = 0.2 * jnp.sqrt(jax.random.uniform(radius))
        phi = jax.random.uniform(turn, maxval=2 * jnp.pi)
        target = jnp.stack([r * jnp.cos(phi), r * jnp.sin(phi)])
        qpos = jnp.concatenate([self.model.qpos0[:2] + uniform(angles, 2, 0.1), target])
        qvel = jnp.concatenate([uniform(speeds, 2, 0.005), jnp.zeros(2)])
        return start_from(self.model, qpos, qvel)

    def observe(self, now):
        """Angles, target, velocities and the way to the target."""
        angles = now.qpos[:2]
        return jnp.concatenate(
            [jnp.cos(angles), jnp.sin(angles), now.qpos[2:], now.qvel[:2], self._offset(now)[:2]]
        )

    def reward(self, before, now, action):
        """Closeness, less effort."""
        terms = {
            "reward_dist": -self.reward_dist_weight * distance(self._offset(now)),
            "reward_ctrl": -self.reward_control_weight * jnp.sum(action**2),
        }
        return sum(terms.values()), terms

    def _offset(self, now):
        """From the target to the fingertip (m)."""
        body = self.model.names.id
        return now.xpos[body("body", "fingertip")] - now.xpos[body("body", "target")]
