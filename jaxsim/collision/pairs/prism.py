"""Signed distances of a point from the prisms of a height field, in closed form.

A cell of the grid has two prisms. Seen from above, each is a right triangle: its first leg starts
at the cell's corner with the lowest coordinates, the second ends at the opposite corner, and the
diagonal of the cell is its longest side. The axes of a prism are its first leg, its second leg, and
up.

Let c be the point of the triangle that is nearest to the given point, both seen from above. If the
given point is not above the height of the top at c, the nearest point of the prism is straight
beside it, or on the bottom. Otherwise it is on the top.
"""

from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from jaxsim.collision.frames import direction, unit

Side = tuple[Float[Array, ""], Float[Array, "3"]]


def point_prisms(
    offset: tuple[Float[Array, "c"], Float[Array, "r"]],
    height: Float[Array, "r c"],
    z: Float[Array, ""],
    step: Float[Array, "2"],
    base: Float[Array, ""],
) -> Side:
    """Signed distances of a point from prisms, negative inside, and outward unit normals.

    Args:
      offset: how far the point is from the columns of the grid along x, and from its rows along y.
      height: heights of the grid's points.
      z: height of the point.
      step: lengths of the cells along x and y.
      base: depth of the ground below the origin of heights.

    Returns:
      Distances (p,) and normals (p, 3) at the nearest points of the surfaces, cells along x first,
      of each cell first the prism whose first leg is along y.
    """
    x, y = jnp.meshgrid(*offset)
    at = jnp.stack([x, y, z - height], axis=-1)
    rise = {
        "x": height[:, 1:] - height[:, :-1],
        "y": height[1:] - height[:-1],
        "diagonal": height[1:, 1:] - height[:-1, :-1],
    }
    from_x = _from_edges(at[:, :-1], rise["x"], step[0], 0 * step[1])
    from_y = _from_edges(at[:-1], rise["y"], 0 * step[0], step[1])
    across = _from_edges(at[:-1, :-1], rise["diagonal"], step[0], step[1])
    first = [from_y[:, :-1], from_x[1:], across], [rise["y"][:, :-1], rise["x"][1:]]
    second = [from_x[:-1], from_y[:, 1:], across], [rise["x"][:-1], rise["y"][:, 1:]]
    of_prisms = jax.vmap(_of_prism, in_axes=(0, 0, 0, None, None))
    found = []
    for (edges, rises), swapped in ((first, True), (second, False)):
        swap = (lambda x: x[..., jnp.array([1, 0, 2])]) if swapped else (lambda x: x)
        runs = step[::-1] if swapped else step
        slope = jnp.stack(rises, axis=-1) / runs[None, None]
        from_corner, from_edges, slope = (
            a.reshape(-1, *a.shape[2:])
            for a in (swap(at[:-1, :-1]), swap(jnp.stack(edges, axis=2)), slope)
        )
        dist, normal = of_prisms(from_corner, from_edges, slope, runs, z + base)
        found.append((dist, swap(normal)))
    dist, normal = (jnp.stack(x, axis=1) for x in zip(*found, strict=True))
    return dist.reshape(-1), normal.reshape(-1, 3)


def _from_edges(at, rise, run_x, run_y):
    """Shortest vectors from edges that start `at` away from the point and run and rise so much."""
    run = (jnp.broadcast_to(r, rise.shape) for r in (run_x, run_y))
    along = jnp.stack([*run, rise], axis=-1)
    dot = lambda a, b: jnp.sum(a * b, axis=-1, keepdims=True)  # noqa: E731
    return at - jnp.clip(dot(at, along) / dot(along, along), 0, 1) * along


def _of_prism(
    at: Float[Array, "3"],
    edges: Float[Array, "3 3"],
    slope: Float[Array, "2"],
    step: Float[Array, "2"],
    above: Float[Array, ""],
) -> Side:
    """Signed distance and normal of one prism, in its axes.

    Args:
      at: vector from the corner where the first leg starts to the point.
      edges: shortest vectors from the edges of the top to the point.
      slope: slopes of the top along the legs.
      step: lengths of the legs.
      above: height of the point above the bottom.
    """
    upwards = 1 / jnp.sqrt(1 + slope @ slope)
    normal = upwards * jnp.append(-slope, 1)
    top = upwards * (at[2] - slope @ at[:2]), normal
    on_top = _in_triangle((at - top[0] * normal)[:2], step)

    nearest = _nearest(at[:2], step)
    low = at[2] <= slope @ nearest
    beside = jnp.append(at[:2] - nearest, jnp.minimum(above, 0))
    inside = low & jnp.all(beside == 0)

    longest = jnp.sqrt(step @ step)
    face = _furthest(
        [
            top,
            (-at[1], -unit(1, at)),
            (at[0] - step[0], unit(0, at)),
            (
                (at[1] * step[0] - at[0] * step[1]) / longest,
                jnp.append(jnp.stack([-step[1], step[0]]) / longest, 0),
            ),
            (-above, -unit(2, at)),
        ]
    )
    _, edge = _furthest([(-e @ e, e) for e in edges])
    normal, length = direction(jnp.where(low, beside, edge), face[1])
    outside = _either(~low & on_top, top, (length, normal))
    # On the surface itself, up to rounding, the direction to it does not exist.
    return _either(inside | (length == 0), face, outside)


def _in_triangle(x: Float[Array, "2"], step: Float[Array, "2"]) -> Bool[Array, ""]:
    return (x[1] >= 0) & (x[0] <= step[0]) & (x[1] * step[0] <= x[0] * step[1])


def _nearest(x: Float[Array, "2"], step: Float[Array, "2"]) -> Float[Array, "2"]:
    """The point of the triangle nearest to x."""
    # That of the rectangle if it is in the triangle; otherwise it is on the diagonal.
    boxed = jnp.clip(x, 0, step)
    diagonal = jnp.clip(x @ step / (step @ step), 0, 1) * step
    return jnp.where(boxed[1] * step[0] <= boxed[0] * step[1], boxed, diagonal)


def _furthest(sides: Sequence[Side]) -> Side:
    """The side with the largest number; the first among equals."""
    best, *others = sides
    for other in others:
        best = _either(other[0] > best[0], other, best)
    return best


def _either(first: Bool[Array, ""], one: Side, other: Side) -> Side:
    return jnp.where(first, one[0], other[0]), jnp.where(first, one[1], other[1])
