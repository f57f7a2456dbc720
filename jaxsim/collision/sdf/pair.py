"""A shape with a signed distance function against any other shape."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax
from jaxtyping import Array, Float

from jaxsim.collision.frames import direction, tangent_of, unit
from jaxsim.collision.sdf.body import Body, signed_distance
from jaxsim.collision.sdf.descent import Region, descend, nearest_by, refine
from jaxsim.collision.shapes import INACTIVE, Contacts, Shape
from jaxsim.collision.spread import levelness, one_hot, pick, spread

MAX_CONTACTS = 4
# Contacts that are closer than this, in sizes of the smaller shape, are one.
SAME = 0.02
# Starts in the bounding box of the smaller shape, in its half-lengths: corners and faces, not quite
# symmetric, because the gradient of a symmetric function may vanish in a plane of symmetry.
_CORNERS = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
_FACES = np.concatenate([np.eye(3), -np.eye(3)])
_STARTS = 0.99 * np.concatenate([_CORNERS, _FACES]) + np.array([[0.011, -0.007, 0.005]])


def sdf_pair(body: Body) -> tuple[Callable[[Shape, Shape], Contacts], int]:
    """The pair function of a kind of shape and a signed distance function, and its slots."""
    bounded = body.nearest is not None

    def pair(first: Shape, second: Shape) -> Contacts:
        held = lax.stop_gradient((first, second))
        bodies, fixed = _regions(body, first, second), _regions(body, *held)
        starts, scale = _starts(body, *held)
        sides = [_touching(bodies, fixed, starts, scale, k, bounded) for k in range(2)]
        dist, pos, normal, still = (jnp.concatenate(x) for x in zip(*sides, strict=True))
        chosen, exists = _selected(dist, pos, normal, still, scale)
        dist, pos, normal = (
            jnp.stack([pick(mask, x) for mask in chosen]) for x in (dist, pos, normal)
        )
        normal = normal @ second.mat.T
        return Contacts(
            jnp.where(exists, dist, INACTIVE),
            second.pos[None] + pos @ second.mat.T,
            normal,
            jax.vmap(tangent_of)(normal),
        )

    return pair, MAX_CONTACTS


def _regions(body: Body, first: Shape, second: Shape) -> tuple[Region, Region]:
    """The first and the second shape, in the axes of the second."""
    rot = first.mat.T @ second.mat
    centre = first.mat.T @ (second.pos - first.pos)
    one = lambda x: body.distance(first, centre + rot @ x)  # noqa: E731
    two = lambda x: signed_distance.distance(second, x)  # noqa: E731
    nearest = nearest_by(one)
    if body.nearest is not None:
        there = body.nearest
        nearest = lambda x: (there(first, centre + rot @ x) - centre) @ rot  # noqa: E731
    return Region(one, nearest), Region(two, nearest_by(two))


def _touching(bodies, fixed, starts, scale, k: int, bounded: bool):
    """Distances, midpoints, normals and stationarity of the deepest points in body k.

    If the distance to the first body is a bound where it is positive, none there count.
    """
    a, b, *held = bodies[k], bodies[1 - k], fixed[k], fixed[1 - k]
    found = lax.stop_gradient(jax.vmap(lambda x: descend(held[0], held[1], x, scale))(starts))
    x, still = jax.vmap(lambda x: refine(a, b, (held[0], held[1]), x, scale))(found)
    dist, slope = jax.vmap(jax.value_and_grad(a.distance))(x)
    out = jax.vmap(lambda v: direction(v, unit(2, v))[0])(slope)
    pos = x - out * (dist / 2)[:, None]
    if k == 0 and bounded:
        dist = jnp.where(dist > 0, jnp.inf, dist)
    return dist, pos, out if k == 0 else -out, still


def _starts(
    body: Body, first: Shape, second: Shape
) -> tuple[Float[Array, "n 3"], Float[Array, ""]]:
    """Starting points, in the axes of the second shape, and the size of the smaller shape."""
    own = jnp.asarray(_STARTS, second.size.dtype) * second.size[None]
    if body.half is None:
        return own, jnp.min(second.size)
    half = body.half(first)
    there = jnp.asarray(_STARTS, second.size.dtype) * half[None]
    there = first.pos[None] + there @ first.mat.T - second.pos[None]
    smaller = jnp.max(half) < jnp.max(second.size)
    scale = jnp.minimum(jnp.min(half), jnp.min(second.size))
    return jnp.where(smaller, there @ second.mat, own), scale


def _selected(dist, pos, normal, still, scale):
    """Masks of the deepest point, and of those that lie almost as deep, far from each other."""
    dist, pos, normal = lax.stop_gradient((dist, pos, normal))
    dist = jnp.where(jnp.isfinite(dist), dist, jnp.inf)
    deepest = one_hot(-dist)
    apart = jnp.sqrt(jnp.sum((pos - pick(deepest, pos)[None]) ** 2, axis=1))
    weight = levelness(dist - jnp.min(dist), apart) * still * (apart > SAME * scale)
    return spread(pos, dist, weight, pick(deepest, normal))
