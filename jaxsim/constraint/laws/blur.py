"""Any law of contact, smoothed, so that optimisers feel contacts before they touch.

Normal forces f_n are the law's, averaged over distances that are off by logistic noise of scale s,
which leaves a force at a distance. Friction is smooth,

    f_t = -mu f_n v_t / sqrt(v_s^2 + |v_t|^2),    v_t the velocity after the step

(Kurtz and others 2023, "Inverse dynamics trajectory optimization for contact-implicit model
predictive control"). There is no cost with these forces, so the solver has no use for them. The
options of `jaxsim.gradients.Backward` are another thing: they soften the derivatives of solves.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.constraint.laws.law import ContactLaw, ContactState
from jaxsim.model import Option
from jaxsim.solver import Kind

# The trapezoidal rule for the logistic distribution; its tail is what is felt at a distance.
_NODES = np.arange(-10.5, 5, 1.5)
_WEIGHTS = 1 / np.cosh(_NODES / 2) ** 2


@struct.dataclass
class Blur:
    """How much a law is smoothed.

    Attributes:
      length: s, the scale of the noise in distances (m).
      speed: v_s, below which friction is like that of oil (m/s).
    """

    length: Float[Array, ""]
    speed: Float[Array, ""]


@struct.dataclass
class SmoothForce:
    """Forces of n contacts with d rows; there is no cost.

    Attributes:
      sharp: costs of the law itself, whose forces are those of a speed of zero.
      velocity: before the step.
      normals: costs of the normal rows, whose arrays are (n, nodes, 1).
      friction: coefficients of the friction rows.
      timestep: h (s).
      speed: v_s (m/s).
    """

    sharp: Kind
    velocity: Float[Array, "n d"]
    normals: Kind
    friction: Float[Array, "n d-1"]
    timestep: Float[Array, "n"]
    speed: Float[Array, "n"]

    @property
    def aref(self) -> Float[Array, "n d"]:
        """Reference acceleration of the law itself."""
        return self.sharp.aref

    def force(self, r: Float[Array, "n d"]) -> Float[Array, "n d"]:
        """The forces at the accelerations `r + aref`."""
        speed = jnp.where(self.speed > 0, self.speed, 1.0)
        a = r + self.aref
        forces = jax.vmap(lambda kind: kind.force(a[:, :1] - kind.aref), in_axes=1)(self.normals)
        normal = jnp.tensordot(jnp.asarray(_WEIGHTS / _WEIGHTS.sum(), r.dtype), forces, 1)
        slip = (self.velocity + self.timestep[:, None] * a)[:, 1:]
        length = jnp.sqrt(speed**2 + jnp.sum(slip * slip, axis=1))
        friction = -normal * self.friction * slip / length[:, None]
        smooth = jnp.concatenate([normal, friction], axis=1)
        return jnp.where((self.speed > 0)[:, None], smooth, self.sharp.force(r))


def blurred(law: ContactLaw, blur: Blur) -> Callable[[Option, ContactState], Any]:
    """The law, smoothed."""

    def smooth(opt: Option, contact: ContactState) -> SmoothForce:
        # The law without friction, at every distance.
        normal = contact.replace(velocity=contact.velocity[:1])
        off = blur.length * jnp.asarray(_NODES, contact.dist.dtype)
        return SmoothForce(
            sharp=law(opt, contact),
            velocity=contact.velocity,
            normals=jax.vmap(lambda off: law(opt, normal.replace(dist=contact.dist + off)))(off),
            friction=contact.friction[: contact.condim - 1],
            timestep=opt.timestep,
            speed=blur.speed,
        )

    return smooth
