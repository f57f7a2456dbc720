"""The cylinder as a convex solid."""

import jax.numpy as jnp
import numpy as np

from jaxsim.collision.convex.solid import Feature, Solid, extent_of
from jaxsim.collision.frames import unit

# Below this sine of the angle to its axis, a normal counts as parallel to the axis.
LEVEL = 1e-7
# Number of corners of the polygon that replaces a cap in face contacts, as in MuJoCo.
SIDES = 16
_AROUND = np.arange(SIDES) * (2 * np.pi / SIDES)
_CIRCLE = np.stack([np.cos(_AROUND), np.sin(_AROUND)])


class Cylinder(Solid):
    """A cylinder along its third axis; the upper rim has number 1, the lower rim 0."""

    curved = True
    capped = True
    max_contacts = 4

    @property
    def reach(self):
        """See `Solid`."""
        return jnp.maximum(self.size[0], self.size[1])

    def support(self, d):
        """See `Solid`."""
        upper = (d[2] >= 0).astype(jnp.int32)
        radial, _ = self._radial(d, jnp.zeros_like(d))
        return self._rim(radial, upper), upper

    def point(self, vertex, n):
        """See `Solid`."""
        # If n is normal to the cap, any point of the rim is a support point: keep the vertex.
        here, _ = self._radial(vertex[0], jnp.zeros_like(n))
        radial, sine = self._radial(n, here)
        return self._rim(jnp.where(sine > LEVEL, radial, here), vertex[1])

    def support_derivative(self, n, e):
        """See `Solid`."""
        radial, sine = self._radial(n, jnp.zeros_like(n))
        along = jnp.cross(unit(2, n), radial)
        return along * (along @ e) * (self.size[0] / jnp.maximum(sine, LEVEL))

    def feature(self, numbers, n):
        """A point of a rim, which is part of a cap, or the line between both rims; see `Solid`."""
        extent = jnp.minimum(extent_of(jnp.sort(numbers)), 2)
        side = jnp.where(jnp.where(extent > 1, n[2] >= 0, numbers[0] > 0), 1, -1).astype(n.dtype)
        radial, _ = self._radial(n, unit(0, n))
        cap = unit(2, n) * side
        corner, height = radial * self.size[0], cap * self.size[1]
        return Feature(
            extent=extent,
            number=jnp.where(side > 0, 0, 1)[None].astype(jnp.int32),
            normal=cap[None],
            holds=(extent == 1)[None],
            corner=corner + height,
            ends=(corner - height)[None],
            along=jnp.ones(1, bool),
        )

    def ring(self, face):
        """A regular polygon in place of a cap; see `Solid`."""
        side = jnp.where(face == 0, 1, -1).astype(self.size.dtype)
        x, y = jnp.asarray(_CIRCLE, self.size.dtype) * self.size[0]
        height = jnp.broadcast_to(side * self.size[1], x.shape)
        return jnp.stack([x, -side * y, height], axis=1), SIDES

    def _radial(self, d, fallback):
        across = d * jnp.array([1, 1, 0], d.dtype)
        square = across @ across
        regular = square > float(jnp.finfo(d.dtype).tiny)
        length = jnp.sqrt(jnp.where(regular, square, 1))
        return jnp.where(regular, across / length, fallback), jnp.where(regular, length, 0)

    def _rim(self, radial, upper):
        height = jnp.where(upper > 0, self.size[1], -self.size[1])
        return radial * self.size[0] + unit(2, radial) * height
