"""Stiffness, damping and impedance of constraint rows from `solref` and `solimp`.

The reference acceleration of a row is `aref = -b v - k d r` and its regularisation is
`R = (1 - d) / d * A`. Here r is the violation, v its rate, k the stiffness, b the damping, d the
impedance and A the row's inverse inertia (MuJoCo documentation, chapter "Computation", section
"Constraint model").
"""

import jax.numpy as jnp
import mujoco
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.arrays.constants import MAXIMP, MINIMP, MINVAL
from jaxsim.model import Option

# MuJoCo's replacement for a solref whose two numbers differ in sign.
DEFAULT_SOLREF = (0.02, 1.0)

_REFSAFE_OFF = mujoco.mjtDisableBit.mjDSBL_REFSAFE


@struct.dataclass
class Response:
    """Stiffness, damping and impedance of one constraint.

    Attributes:
      stiffness: k (1/s^2).
      damping: b (1/s).
      impedance: d, between 0 and 1.
    """

    stiffness: Float[Array, ""]
    damping: Float[Array, ""]
    impedance: Float[Array, ""]

    def reference(self, velocity: Float[Array, "..."], violation: Array | float) -> Array:
        """Reference acceleration `-b v - k d r`."""
        return -self.damping * velocity - self.stiffness * self.impedance * violation

    def regularisation(self, inverse_inertia: Float[Array, "..."]) -> Array:
        """`R = (1 - d) / d * A`."""
        return jnp.maximum((1 - self.impedance) / self.impedance * inverse_inertia, MINVAL)


def response(
    opt: Option, solref: Float[Array, "2"], solimp: Float[Array, "5"], violation: Float[Array, ""]
) -> Response:
    """Stiffness, damping and impedance of one constraint.

    Args:
      opt: the model's options; `refsafe` keeps time constants above two timesteps.
      solref: (time constant, damping ratio), or (-stiffness, -damping).
      solimp: (dmin, dmax, width, midpoint, power).
      violation: the violation; its norm for a constraint of several rows.
    """
    time, ratio = _reference(opt, solref)
    dmax = jnp.clip(solimp[1], MINIMP, MAXIMP)
    standard = time > 0
    # Both branches are evaluated; each gets finite arguments where the other is selected.
    safe_time, safe_ratio = jnp.where(standard, time, 1.0), jnp.where(standard, ratio, 1.0)
    spring = 1 / jnp.maximum(dmax**2 * safe_time**2 * safe_ratio**2, MINVAL)
    return Response(
        stiffness=jnp.where(standard, spring, -time / dmax**2),
        damping=jnp.where(standard, 2 / (dmax * safe_time), -ratio / dmax),
        impedance=impedance(solimp, violation),
    )


def inverse_where(active: Bool[Array, "..."], R: Float[Array, "*n"]) -> Float[Array, "*n"]:
    """D of rows: `1 / R` where active, else zero, which removes the row from the problem."""
    return jnp.where(active, 1 / jnp.where(active, R, 1.0), 0.0)


def impedance(solimp: Float[Array, "5"], violation: Float[Array, ""]) -> Float[Array, ""]:
    """The impedance d, which rises from dmin at violation zero to dmax at `width`.

    Between them it follows two power laws, which meet at `midpoint`.
    """
    dmin = jnp.clip(solimp[0], MINIMP, MAXIMP)
    dmax = jnp.clip(solimp[1], MINIMP, MAXIMP)
    width, power = solimp[2], jnp.maximum(solimp[4], 1.0)
    middle = jnp.clip(solimp[3], MINIMP, MAXIMP)
    flat = width <= MINVAL
    x = jnp.abs(violation) / jnp.where(flat, 1.0, width)
    inside = (x > 0) & (x < 1)
    x_safe = jnp.where(inside, x, 0.5)
    lower = x_safe <= middle
    # The upper power law is the lower one, rotated by half a turn.
    base, scale = jnp.where(lower, x_safe, 1 - x_safe), jnp.where(lower, middle, 1 - middle)
    # `**` of positive numbers, but XLA vectorises this.
    curve = scale * jnp.exp(power * jnp.log(base / scale))
    y = jnp.where(lower, curve, 1 - curve)
    y = jnp.where(inside, y, jnp.where(x >= 1, 1.0, 0.0))
    return jnp.where(flat, 0.5 * (dmin + dmax), dmin + y * (dmax - dmin))


def _reference(opt: Option, solref: Float[Array, "2"]) -> tuple[Array, Array]:
    """The numbers of solref, with mixed signs replaced and, by `refsafe`, a large time constant."""
    mixed = (solref[0] > 0) != (solref[1] > 0)
    time = jnp.where(mixed, DEFAULT_SOLREF[0], solref[0])
    ratio = jnp.where(mixed, DEFAULT_SOLREF[1], solref[1])
    if not opt.disabled(_REFSAFE_OFF):
        time = jnp.where(time > 0, jnp.maximum(time, 2 * opt.timestep), time)
    return time, ratio
