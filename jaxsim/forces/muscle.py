"""Muscles: activation that follows the control, and force that depends on length and velocity.

MuJoCo documentation, chapter Modeling, section "Muscles". Curves are in normalised units: length
1 is the optimal length L0, velocity 1 is the fastest shortening in L0 per second, force 1 is the
peak active force. All functions are for one muscle. They are continuously differentiable, except
between rising and falling activation if the transition has width zero.
"""

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL


def muscle_activation_rate(
    ctrl: Float[Array, ""], act: Float[Array, ""], prm: Float[Array, "10"]
) -> Float[Array, ""]:
    """Rate of the activation, `(ctrl - act) / tau`, after Millard et al. (2013).

    Args:
      ctrl: excitation, clamped to [0, 1].
      act: activation.
      prm: time constants of activation and deactivation (s), and the width of the transition
        between them; zero for a discontinuous transition.
    """
    scale = 0.5 + 1.5 * jnp.clip(act, 0, 1)
    rising, falling, width = prm[0] * scale, prm[1] / scale, prm[2]
    excess = jnp.clip(ctrl, 0, 1) - act
    hard = width < MINVAL
    weight = jnp.where(excess > 0, 1.0, 0.0)
    weight = jnp.where(hard, weight, _smoothstep(excess / jnp.where(hard, 1.0, width) + 0.5))
    return excess / jnp.maximum(falling + (rising - falling) * weight, MINVAL)


def muscle_gain(
    length: Float[Array, ""],
    velocity: Float[Array, ""],
    lengthrange: Float[Array, "2"],
    acc0: Float[Array, ""],
    prm: Float[Array, "10"],
) -> Float[Array, ""]:
    """Force per unit activation, `-F FL(L) FV(V)`; negative, because muscles pull.

    Args:
      length: length of the actuator.
      velocity: its rate.
      lengthrange: smallest and largest feasible length.
      acc0: acceleration from a unit force in the reference configuration.
      prm: range (2 numbers), force, scale, lmin, lmax, vmax, fpmax, fvmax.
    """
    x, optimum = _normalised(length, lengthrange, prm)
    v = velocity / jnp.maximum(optimum * prm[6], MINVAL)
    curves = active_force_length(x, prm[4], prm[5]) * force_velocity(v, prm[8])
    return -_peak_force(acc0, prm) * curves


def muscle_bias(
    length: Float[Array, ""],
    lengthrange: Float[Array, "2"],
    acc0: Float[Array, ""],
    prm: Float[Array, "10"],
) -> Float[Array, ""]:
    """Passive force, `-F FP(x)`: zero up to the optimal length, then quadratic, then linear."""
    x, _ = _normalised(length, lengthrange, prm)
    knee = (1 + prm[5]) / 2
    width = jnp.maximum(knee - 1, MINVAL)
    quadratic = _parabola(jnp.minimum(x, knee) - 1, knee - 1)
    linear = jnp.where(x > knee, (x - knee) / width, 0.0)
    curve = jnp.where(x > 1, quadratic + linear, 0.0)
    return -_peak_force(acc0, prm) * prm[7] * curve


def active_force_length(
    x: Float[Array, ""], lmin: Float[Array, ""], lmax: Float[Array, ""]
) -> Float[Array, ""]:
    """Active force at normalised length x: four parabolas, zero at `lmin` and `lmax`, one at 1."""
    rising, falling = (lmin + 1) / 2, (1 + lmax) / 2
    up = jnp.where(x > rising, 1 - _parabola(1 - x, 1 - rising), _parabola(x - lmin, rising - lmin))
    down = jnp.where(
        x > falling, _parabola(lmax - x, lmax - falling), 1 - _parabola(x - 1, falling - 1)
    )
    return jnp.where((x < lmin) | (x > lmax), 0.0, jnp.where(x > 1, down, up))


def force_velocity(v: Float[Array, ""], fvmax: Float[Array, ""]) -> Float[Array, ""]:
    """Force at normalised velocity v: zero for v <= -1, one at rest, `fvmax` for v >= fvmax - 1."""
    y = fvmax - 1
    shortening = jnp.where(v <= -1, 0.0, (v + 1) * (v + 1))
    lengthening = jnp.where(v <= y, fvmax - (y - v) * (y - v) / jnp.maximum(y, MINVAL), fvmax)
    return jnp.where(v <= 0, shortening, lengthening)


def _parabola(x, width):
    scaled = x / jnp.maximum(width, MINVAL)
    return 0.5 * scaled * scaled


def _smoothstep(x):
    """`6 x^5 - 15 x^4 + 10 x^3` between 0 and 1, constant outside."""
    x = jnp.clip(x, 0, 1)
    return x * x * x * (3 * x * (2 * x - 5) + 10)


def _normalised(length, lengthrange, prm):
    """Length in units of the optimal length, and that length."""
    optimum = (lengthrange[1] - lengthrange[0]) / jnp.maximum(prm[1] - prm[0], MINVAL)
    return prm[0] + (length - lengthrange[0]) / jnp.maximum(optimum, MINVAL), optimum


def _peak_force(acc0, prm):
    """Peak active force: the parameter `force`, or `scale / acc0` where that is negative."""
    return jnp.where(prm[2] < 0, prm[3] / jnp.maximum(acc0, MINVAL), prm[2])
