"""Common base of humanoid and humanoid_standup: the observation of a whole body."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.dynamics.tendons.fixed import fixed_length, fixed_velocity
from jaxsim.envs.base.env import Task, static
from jaxsim.envs.base.moment import Moment
from jaxsim.envs.base.start import uniform_start


@struct.dataclass(kw_only=True)
class WholeBody(Task):
    """A robot with a floating base, observed with its inertias and forces."""

    frame_skip: int = static(5)
    reset_noise_scale: float = 1e-2
    exclude_current_positions_from_observation: bool = static(True)
    include_cinert_in_observation: bool = static(True)
    include_cvel_in_observation: bool = static(True)
    include_qfrc_actuator_in_observation: bool = static(True)
    include_cfrc_ext_in_observation: bool = static(True)

    def start(self, key):
        """Near the pose of the file, at rest."""
        return uniform_start(self.model, key, self.reset_noise_scale)

    def observe(self, now):
        """Positions except x and y, velocities, and the groups that the options select."""
        skip = 2 * self.exclude_current_positions_from_observation
        parts = [now.qpos[skip:], now.qvel]
        if self.include_cinert_in_observation:
            parts.append(now.cinert[1:].ravel())
        if self.include_cvel_in_observation:
            parts.append(now.cvel[1:].ravel())
        if self.include_qfrc_actuator_in_observation:
            parts.append(now.qfrc_actuator[6:])
        if self.include_cfrc_ext_in_observation:
            parts.append(now.cfrc_ext[1:].ravel())
        return jnp.concatenate(parts)

    def info(self, now):
        """Where the torso is, and how far the tendons are stretched."""
        return {
            "x_position": now.qpos[0],
            "y_position": now.qpos[1],
            "tendon_length": fixed_length(self.model, now.last.qpos),
            "tendon_velocity": fixed_velocity(self.model, now.last.qvel),
        }


def contact_cost(now: Moment, weight: float, limits: tuple[float, float]) -> Float[Array, ""]:
    """Price of the squared external wrenches on all bodies, clipped."""
    return jnp.clip(weight * jnp.sum(now.cfrc_ext**2), *limits)
