"""Round solids: the cores of spheres and capsules, and ellipsoids."""

import jax.numpy as jnp

from jaxsim.collision.convex.solid import Facet, Solid
from jaxsim.collision.frames import direction, unit


class Point(Solid):
    """The core of a sphere."""

    @property
    def radius(self):
        """See `Solid`."""
        return self.size[0]

    @property
    def reach(self):
        """See `Solid`."""
        return self.size[0]

    def support(self, d):
        """See `Solid`."""
        return jnp.zeros_like(d), jnp.zeros((), jnp.int32)

    def point(self, vertex, n):
        """See `Solid`."""
        return jnp.zeros_like(n)


class Segment(Solid):
    """The core of a capsule."""

    max_contacts = 2

    @property
    def radius(self):
        """See `Solid`."""
        return self.size[0]

    @property
    def reach(self):
        """See `Solid`."""
        return self.size[0] + self.size[1]

    def support(self, d):
        """See `Solid`."""
        upper = (d[2] >= 0).astype(jnp.int32)
        return self.point((d, upper), d), upper

    def point(self, vertex, n):
        """See `Solid`."""
        return unit(2, n) * jnp.where(vertex[1] > 0, self.size[1], -self.size[1])

    def facet(self, n):
        """See `Solid`."""
        end = unit(2, n) * self.size[1]
        normal, _ = direction(n * jnp.array([1, 1, 0], n.dtype), unit(0, n))
        return Facet(jnp.stack([end, -end]), normal, flat=False)


class Ellipsoid(Solid):
    """An ellipsoid; with S = diag(size), the support point is `S S d / |S d|`."""

    curved = True

    @property
    def reach(self):
        """See `Solid`."""
        return jnp.max(self.size)

    def support(self, d):
        """See `Solid`."""
        return self.point((d, jnp.zeros((), jnp.int32)), d), jnp.zeros((), jnp.int32)

    def point(self, vertex, n):
        """See `Solid`."""
        scaled = self.size * n
        return self.size * scaled / jnp.sqrt(scaled @ scaled)

    def support_derivative(self, n, e):
        """See `Solid`."""
        scaled = self.size * n
        length = jnp.sqrt(scaled @ scaled)
        first, across = scaled / length, self.size * e
        return self.size * (across - first * (first @ across)) / length
