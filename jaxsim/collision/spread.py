"""A few contacts out of many that support a face as well as all of them."""

import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Float

# Faces lie on each other up to this angle, which is MuJoCo's: its sine and cosine.
SINE, COSINE = 0.0889, 0.99604
# Points closer than this to a line are on it, relative to how far they extend.
CLOSE = 1e-3


def spread(
    points: Float[Array, "n 3"],
    dist: Float[Array, "n"],
    weight: Float[Array, "n"],
    normal: Float[Array, "3"],
    count: int,
) -> tuple[Bool[Array, "{count} n"], Bool[Array, "{count}"]]:
    """The deepest point, the one furthest from it, and two that make a large quadrilateral.

    Args:
      points: where contacts may be.
      dist: their distances; infinite where there is none.
      weight: how much being far from the others counts for each.
      normal: unit normal of the contacts.
      count: how many are wanted, 2 or 4.

    Returns:
      For each of them a mask with one element set, and which there are.
    """
    deepest = one_hot(-dist)
    from_deepest = points - pick(deepest, points)[None]
    length = weight * jnp.sum(from_deepest**2, axis=1)
    furthest = one_hot(length)
    along = pick(furthest, from_deepest)
    chosen, exists = [deepest, furthest], [jnp.any(dist < jnp.inf), jnp.max(length) > 0]
    if count > 2:
        # The point of the largest triangle, and that of the largest triangle outside it.
        beside = from_deepest @ jnp.cross(normal, along)
        third = one_hot(weight * jnp.abs(beside))
        side = jnp.where(pick(third, beside) > 0, -1, 1)
        other = pick(third, from_deepest)
        further = (from_deepest - along[None]) @ jnp.cross(normal, other - along)
        back = from_deepest @ jnp.cross(other, normal)
        outside = weight * jnp.maximum(side * beside, jnp.maximum(side * further, side * back))
        chosen += [third, one_hot(outside)]
        areas = jnp.stack([jnp.max(weight * jnp.abs(beside)), jnp.max(outside)])
        exists += list(areas > CLOSE * (along @ along))
    return jnp.stack(chosen), jnp.stack(exists)


def levelness(rise: Float[Array, "n"], apart: Float[Array, "n"]) -> Float[Array, "n"]:
    """One where a point is as deep as the deepest, zero where it is no contact any more.

    Args:
      rise: how much larger its distance is than that of the deepest one.
      apart: how far it is from the deepest one.
    """
    reach = SINE * apart
    return jnp.where(rise < reach, 1 - rise / jnp.where(reach > 0, reach, 1), 0)


def one_hot(x: Float[Array, "n"]) -> Bool[Array, "n"]:
    """Where the largest element is, of equals the first."""
    # Computed once: were it computed again, rounded otherwise, none would be the largest.
    x = lax.optimization_barrier(lax.stop_gradient(x))
    order = jnp.arange(len(x), dtype=jnp.int32)
    return order == jnp.min(jnp.where(x == jnp.max(x), order, len(x)))


def pick(mask: Bool[Array, "n"], x: Float[Array, "n *k"]) -> Float[Array, "*k"]:
    """The element where the mask is set."""
    mask = mask.reshape(-1, *(1,) * (x.ndim - 1))
    return jnp.sum(jnp.where(mask, x, jnp.zeros_like(x)), axis=0, dtype=x.dtype)
