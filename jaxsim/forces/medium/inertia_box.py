"""Drag by the inertia-box model: each body is replaced by the box with its mass and inertia.

Drag acts along each axis of the box separately. MuJoCo documentation, chapter Computation, section
"Inertia-based model".
"""

import math

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.constants import MINVAL
from jaxsim.arrays.polynomial import magnitude
from jaxsim.model import Model


@struct.dataclass
class BoxDrag:
    """Coefficients b and c of the drag `-(b + c |v|) v` of a body, for each component of v.

    Twists and wrenches are about the centre of mass in the axes of the box.
    """

    viscous: Float[Array, "6"]
    quadratic: Float[Array, "6"]

    def wrench(self, twist: Float[Array, "6"]) -> Float[Array, "6"]:
        """Wrench of the medium on the body."""
        return -(self.viscous + self.quadratic * magnitude(twist)) * twist

    def slope(self, twist: Float[Array, "6"]) -> Float[Array, "6 6"]:
        """Minus the derivative of the wrench."""
        return jnp.diag(self.viscous + 2 * self.quadratic * magnitude(twist))


def box_drag(model: Model) -> BoxDrag:
    """Coefficients of all bodies, stacked; zero for bodies without mass."""
    viscosity, density = model.opt.viscosity, model.opt.density

    def one(mass, inertia):
        light = mass < MINVAL
        squares = jnp.sum(inertia) - 2 * inertia
        box = jnp.sqrt(jnp.maximum(squares, MINVAL) / jnp.where(light, 1.0, mass) * 6)
        diameter = jnp.sum(box) / 3
        b = jnp.stack([math.pi * diameter**3] * 3 + [3 * math.pi * diameter] * 3) * viscosity
        x, y, z = box
        turning = jnp.stack([x * (y**4 + z**4), y * (x**4 + z**4), z * (x**4 + y**4)]) / 64
        c = jnp.concatenate([turning, jnp.stack([y * z, x * z, x * y]) / 2]) * density
        return BoxDrag(jnp.where(light, 0.0, b), jnp.where(light, 0.0, c))

    return jax.vmap(one)(model.body_mass, model.body_inertia)
