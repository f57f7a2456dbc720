"""Directions and contact frames with finite values and derivatives everywhere."""

import jax.numpy as jnp
from jaxtyping import Array, Float


def smallest_length(x: Float[Array, "..."]) -> float:
    """Length below which a vector has no direction; 1e-15 in float64, as in MuJoCo."""
    return 4.5 * float(jnp.finfo(x.dtype).eps)


def direction(
    v: Float[Array, "3"], fallback: Float[Array, "3"]
) -> tuple[Float[Array, "3"], Float[Array, ""]]:
    """Unit vector along `v`, and the length of `v`.

    For a vector that is too short they are `fallback` and 0. The derivative of the length is then
    0, the mean of its one-sided derivatives.
    """
    square = v @ v
    regular = square > smallest_length(v) ** 2
    length = jnp.sqrt(jnp.where(regular, square, 1.0))
    return jnp.where(regular, v / length, fallback), jnp.where(regular, length, 0.0)


def unit(index: int, like: Float[Array, "..."]) -> Float[Array, "3"]:
    """The unit vector along world axis `index`, in the precision of `like`."""
    return jnp.zeros(3, like.dtype).at[index].set(1.0)


def tangent_of(normal: Float[Array, "3"]) -> Float[Array, "3"]:
    """The argument `tangent` of `contact_frame` if the pair has no preferred tangent.

    It is the world's y axis, or its z axis if the normal is within 60 degrees of y, as in MuJoCo's
    `mju_makeFrame`.
    """
    steep = jnp.abs(normal[1]) >= 0.5
    return jnp.where(steep, unit(2, normal), unit(1, normal))


def tangent_along(axis: Float[Array, "3"], normal: Float[Array, "3"]) -> Float[Array, "3"]:
    """The argument `tangent` of `contact_frame` for a first tangent along an axis.

    An axis parallel to the normal is replaced by the world's x axis, or by y if the normal is close
    to x, as in MuJoCo (which does not make it orthogonal to the normal).
    """
    across = jnp.cross(normal, axis)
    parallel = across @ across < smallest_length(across) ** 2
    other = jnp.where(jnp.abs(normal[0]) >= 0.5, unit(1, normal), unit(0, normal))
    return jnp.where(parallel, other, axis)


def contact_frame(normal: Float[Array, "3"], tangent: Float[Array, "3"]) -> Float[Array, "3 3"]:
    """Contact frame of a unit normal; rows are the normal and two tangents.

    Args:
      normal: the normal.
      tangent: vector whose projection on the tangent plane is along the first tangent.
    """
    # A double cross product, unlike t - n (n . t), stays orthogonal to the normal in float32 even
    # when t is almost parallel to it.
    first = jnp.cross(jnp.cross(normal, tangent), normal)
    first = first / jnp.sqrt(first @ first)
    return jnp.stack([normal, first, jnp.cross(normal, first)])
