"""Directions and contact frames without singular values or derivatives."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def smallest_length(x: Float[Array, "..."]) -> float:
    """Length below which a vector of this precision has no direction: MuJoCo's 1e-15 in float64."""
    return 4.5 * float(jnp.finfo(x.dtype).eps)


def direction(
    v: Float[Array, "3"], fallback: Float[Array, "3"]
) -> tuple[Float[Array, "3"], Float[Array, ""]]:
    """Unit vector along `v` and the length of `v`.

    A vector too short to have a direction returns `fallback` and length 0; its derivatives are then
    those of `fallback` and 0, which is the mean of the one-sided derivatives of the length.
    """
    square = v @ v
    regular = square > smallest_length(v) ** 2
    length = jnp.sqrt(jnp.where(regular, square, 1.0))
    return jnp.where(regular, v / length, fallback), jnp.where(regular, length, 0.0)


def unit(index: int, like: Float[Array, "..."]) -> Float[Array, "3"]:
    """The unit vector along world axis `index`, in the precision of `like`."""
    return jnp.zeros(3, like.dtype).at[index].set(1.0)


def tangent_of(normal: Float[Array, "3"]) -> Float[Array, "3"]:
    """First tangent where nothing but the normal is known, as `contact_frame` takes it.

    The world's y axis, or its z axis where the normal is within 60 degrees of y (MuJoCo's
    `mju_makeFrame`).
    """
    steep = jnp.abs(normal[1]) >= 0.5
    return jnp.where(steep, unit(2, normal), unit(1, normal))


def tangent_along(axis: Float[Array, "3"], normal: Float[Array, "3"]) -> Float[Array, "3"]:
    """First tangent along an axis, as `contact_frame` takes it.

    An axis parallel to the normal has no projection. The world's x axis (y where the normal is
    close to x) takes its place, as in MuJoCo, which does not make it orthogonal to the normal.
    """
    across = jnp.cross(normal, axis)
    parallel = across @ across < smallest_length(across) ** 2
    other = jnp.where(jnp.abs(normal[0]) >= 0.5, unit(1, normal), unit(0, normal))
    return jnp.where(parallel, other, axis)


def contact_frame(normal: Float[Array, "3"], tangent: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Contact frame of a unit normal; rows are the normal and two tangents.

    Args:
      normal: the normal.
      tangent: what the first tangent is the direction of, once projected on the tangent plane.
    """
    # A double cross product, unlike t - n (n . t), stays orthogonal to the normal in float32 even
    # when t is almost parallel to it.
    first = jnp.cross(jnp.cross(normal, tangent), normal)
    first = first / jnp.sqrt(first @ first)
    return jnp.stack([normal, first, jnp.cross(normal, first)])
