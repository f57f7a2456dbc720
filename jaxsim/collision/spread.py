"""Selection of a few contacts that support a face as well as all of them."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

# Sine of the largest angle between faces that lie on each other, as in MuJoCo.
SINE = 0.0889
# Points count as collinear if they are closer to a line than this fraction of its length.
CLOSE = 1e-3


def spread(
    points: Float[Array, "n 3"],
    dist: Float[Array, "n"],
    weight: Float[Array, "n"],
    normal: Float[Array, "3"],
) -> tuple[Bool[Array, "4 n"], Bool[Array, "4"]]:
    """The deepest point, the point furthest from it, and two that span a large quadrilateral.

    Args:
      points: positions of possible contacts.
      dist: their distances; infinite for those that do not exist.
      weight: factor of each point's distance from the others.
      normal: unit normal of the contacts.

    Returns:
      For each selected contact a mask with one element set, and whether it exists.
    """
    deepest = one_hot(-dist)
    from_deepest = points - pick(deepest, points)[None]
    length = weight * jnp.sum(from_deepest**2, axis=1)
    furthest = one_hot(length)
    along = pick(furthest, from_deepest)
    # The point that makes the largest triangle, and the one that adds the largest area to it.
    beside = from_deepest @ jnp.cross(normal, along)
    third = one_hot(weight * jnp.abs(beside))
    side = jnp.where(pick(third, beside) > 0, -1, 1)
    other = pick(third, from_deepest)
    further = (from_deepest - along[None]) @ jnp.cross(normal, other - along)
    back = from_deepest @ jnp.cross(other, normal)
    outside = weight * jnp.maximum(side * beside, jnp.maximum(side * further, side * back))
    areas = jnp.stack([jnp.max(weight * jnp.abs(beside)), jnp.max(outside)])
    exists = [jnp.any(dist < jnp.inf), jnp.max(length) > 0, *(areas > CLOSE * (along @ along))]
    return jnp.stack([deepest, furthest, third, one_hot(outside)]), jnp.stack(exists)


def levelness(rise: Float[Array, "n"], apart: Float[Array, "n"]) -> Float[Array, "n"]:
    """Weight of each point: one for the depth of the deepest point, falling to zero.

    It is zero where the line to the deepest point has the largest angle of `SINE`.

    Args:
      rise: distance of each point minus that of the deepest point.
      apart: length from each point to the deepest point.
    """
    reach = SINE * apart
    return jnp.where(rise < reach, 1 - rise / jnp.where(reach > 0, reach, 1), 0)


def one_hot(x: Float[Array, "n"]) -> Bool[Array, "n"]:
    """Mask of the largest element; the first among equals."""
    # The barrier keeps XLA from recomputing x with other rounding, so that no element is equal.
    x = lax.optimization_barrier(lax.stop_gradient(x))
    order = jnp.arange(len(x), dtype=jnp.int32)
    return order == jnp.min(jnp.where(x == jnp.max(x), order, len(x)))


def pick(mask: Bool[Array, "n"], x: Float[Array, "n *k"]) -> Float[Array, "*k"]:
    """The element of x at which the mask, with one element set, is true."""
    mask = mask.reshape(-1, *(1,) * (x.ndim - 1))
    return jnp.sum(jnp.where(mask, x, jnp.zeros_like(x)), axis=0, dtype=x.dtype)
