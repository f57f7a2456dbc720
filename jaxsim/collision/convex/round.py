"""Round solids: the cores of spheres and capsules, and ellipsoids."""

import jax.numpy as jnp

from jaxsim.collision.convex.solid import Feature, Solid, extent_of
from jaxsim.collision.frames import unit

# If the sine of the angle between a normal and the side of a capsule is below this, all of the side
# may touch. MuJoCo's search says so for some of these normals, and for hardly any others.
LYING = 0.0889


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

    has_faces = False
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

    def feature(self, numbers, n):
        """An end of the line on its side that touches, or all of it; see `Solid`.

        As in MuJoCo, it is at support points without their parts along the axis, and half of the
        margin is added to the radius; this half is taken off later, along the normal of the face.
        """
        end = self.point((n, numbers[0]), n)
        out = (self.radius + self.margin / 2) * n * jnp.array([1, 1, 0], n.dtype)
        extent = extent_of(jnp.sort(numbers))
        return Feature(
            extent=extent,
            number=jnp.zeros(1, jnp.int32),
            normal=jnp.zeros_like(n)[None],
            holds=jnp.zeros(1, bool),
            corner=out + end,
            ends=(out - end)[None],
            along=((extent > 1) | (jnp.abs(n[2]) < LYING))[None],
        )


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
