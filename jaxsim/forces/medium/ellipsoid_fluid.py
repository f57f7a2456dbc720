"""Forces of a medium on ellipsoids: added mass, lift of Magnus and Kutta, viscous and blunt drag.

MuJoCo documentation, chapter Computation, section "Ellipsoid-based model"; `mj_viscousForces` and
`mj_addedMassForces`. The areas and cosines of MuJoCo's formulas are written with the direction of
the velocity and the shape of the ellipsoid, which have no dimension, so that nothing underflows.
"""

import math

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.norms import safe_norm
from jaxsim.model import Model

_SPHERE = int(mujoco.mjtGeom.mjGEOM_SPHERE)
_CAPSULE = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
_CYLINDER = int(mujoco.mjtGeom.mjGEOM_CYLINDER)


@struct.dataclass
class EllipsoidDrag:
    """An ellipsoid in a medium; twists and wrenches are about its centre in its axes.

    Attributes:
      semiaxes: its half widths (m).
      fluid: coefficients of a geom as in `model.geom_fluid`: scale, blunt, slender and angular
        drag, lift of Kutta and of Magnus, three virtual volumes (m^3) and virtual moments (m^5).
      density: density of the medium (kg/m^3).
      viscosity: its viscosity (Pa s).
    """

    semiaxes: Float[Array, "3"]
    fluid: Float[Array, "12"]
    density: Float[Array, ""]
    viscosity: Float[Array, ""]

    def wrench(self, twist: Float[Array, "6"]) -> Float[Array, "6"]:
        """Wrench of the medium on the ellipsoid that moves relative to it."""
        omega, v = twist[:3], twist[3:]
        momentum = self.density * self.fluid[9:] * omega, self.density * self.fluid[6:9] * v
        torque = jnp.cross(momentum[1], v) + jnp.cross(momentum[0], omega)
        force = jnp.cross(momentum[1], omega) + self._magnus(omega, v) + self._translational(v)
        return self.fluid[0] * jnp.concatenate([torque + self._rotational(omega), force])

    def slope(self, twist: Float[Array, "6"]) -> Float[Array, "6 6"]:
        """Minus the derivative of the wrench; not symmetric."""
        return -jax.jacfwd(self.wrench)(twist)

    def _magnus(self, omega, v) -> Float[Array, "3"]:
        volume = 4 / 3 * math.pi * jnp.prod(self.semiaxes)
        return self.fluid[5] * self.density * volume * jnp.cross(omega, v)

    def _translational(self, v) -> Float[Array, "3"]:
        """Viscous and quadratic drag, and the lift by the theorem of Kutta and Joukowski."""
        _, middle, largest = jnp.sort(self.semiaxes)
        blunt, slender = self.fluid[1], self.fluid[2]
        moving = v @ v > 0
        u = jnp.where(moving, v, jnp.ones_like(v))
        u = u / jnp.linalg.norm(u)
        # Squares of the areas of the ellipsoid's shadows along its axes, the largest of them one.
        shadow = (jnp.min(self.semiaxes) / self.semiaxes) ** 2
        first, second = shadow @ (u * u), (shadow * shadow) @ (u * u)
        largest_area = math.pi * largest * middle
        area = largest_area * jnp.sqrt(second / first)
        lift = self.fluid[4] * area * first / second * (v @ v)
        lift = lift * jnp.cross(jnp.cross(shadow * u, u), u)
        drag = safe_norm(v) * (area * blunt + slender * (largest_area - area))
        viscous = 3 * math.pi * self._diameter() * self.viscosity
        return self.density * lift - (viscous + self.density * drag) * v

    def _rotational(self, omega) -> Float[Array, "3"]:
        """Viscous and quadratic drag of a rotation."""
        sizes = self.semiaxes
        _, middle, largest = jnp.sort(sizes)
        slender, angular = self.fluid[2], self.fluid[3]
        across = jnp.maximum(jnp.roll(sizes, -1), jnp.roll(sizes, -2))
        moments = 8 / 15 * math.pi * sizes * across**4
        greatest = 8 / 15 * math.pi * middle * largest**4
        quadratic = safe_norm((angular * moments + slender * (greatest - moments)) * omega)
        viscous = math.pi * self._diameter() ** 3 * self.viscosity
        return -(viscous + self.density * quadratic) * omega

    def _diameter(self) -> Float[Array, ""]:
        """Diameter of the sphere with the same mean half width (m)."""
        return 2 / 3 * jnp.sum(self.semiaxes)


def ellipsoid_drag(model: Model, geoms: np.ndarray) -> EllipsoidDrag:
    """The ellipsoids that replace some geoms, stacked."""
    n = len(geoms)
    kind, size = model.geom_type[geoms][:, None], take(model.geom_size, geoms)
    radius, half = size[:, :1], size[:, 1:2]
    half = jnp.where(kind == _CAPSULE, radius + half, half)
    half = jnp.where(kind == _SPHERE, radius, half)
    turned = np.isin(kind, (_SPHERE, _CAPSULE, _CYLINDER))
    semiaxes = jnp.where(turned, jnp.concatenate([radius, radius, half], axis=1), size)
    medium = (jnp.broadcast_to(x, (n,)) for x in (model.opt.density, model.opt.viscosity))
    return EllipsoidDrag(semiaxes, take(model.geom_fluid, geoms), *medium)
