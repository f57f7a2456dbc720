"""Box against box: separating axes, then contacts of two faces or of two edges.

Two boxes are disjoint if and only if their projections to one of 15 axes are disjoint: the normals
of their faces and the cross products of their edges (Gottschalk, Lin, Manocha, "OBBTree", 1996).
The axis of the largest separation is the contact normal. If it is the normal of a face, the
opposing face of the other box is clipped by the sides of this face. If it belongs to two edges, the
contact is at their closest points. Rules for near ties are MuJoCo's (`engine_collision_box.c`).
"""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jaxsim.collision.frames import tangent_of
from jaxsim.collision.pairs.clipping import overlap_corners
from jaxsim.collision.shapes import INACTIVE, Contacts, Shape

# Corners of the square [-1, 1]^2, counterclockwise.
_SQUARE = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])
# Two edges are preferred to a face only if their separation is larger by this fraction.
EDGE_BIAS = 1e-6
# The fraction if the axis of two edges is within 8 degrees of the normal of the best face.
ALIGNED, ALIGNED_BIAS = 0.99, 0.05


def box_box(first: Shape, second: Shape) -> Contacts:
    """Up to eight contacts: corners of the intersection of two faces, or one of two edges."""
    boxes = _Boxes(first, second)
    face, edges, edge_wins = boxes.separating_axis()
    dist, pos, normal = boxes.face_contacts(face)
    edge_dist, edge_pos, edge_normal = boxes.edge_contact(edges)
    empty = jnp.arange(len(dist)) > 0
    dist = jnp.where(edge_wins, jnp.where(empty, INACTIVE, edge_dist), dist)
    pos = jnp.where(edge_wins, edge_pos[None], pos)
    normal = first.mat @ jnp.where(edge_wins, edge_normal, normal)
    pos = first.pos[None] + pos @ first.mat.T
    return Contacts(dist, pos, normal[None], tangent_of(normal)[None])


class _Boxes:
    """Two boxes, in the axes of the first and relative to its centre.

    Attributes:
      size1, size2: half-lengths.
      rot: (3, 3) columns are the axes of the second box.
      centre: (3,) centre of the second box.
      back: (3,) `centre` in the axes of the second box.
    """

    def __init__(self, first: Shape, second: Shape):
        self.size1, self.size2 = first.size, second.size
        self.rot = first.mat.T @ second.mat
        between = second.pos - first.pos
        self.centre, self.back = first.mat.T @ between, second.mat.T @ between

    def separating_axis(self) -> tuple[Bool[Array, "6"], Bool[Array, "3 3"], Bool[Array, ""]]:
        """The best face, the best pair of edges, and whether the edges are better.

        Both are masks with one element set; faces are those of the first box, then of the second.
        """
        magnitude = jnp.abs(self.rot)
        sides1 = jnp.abs(self.centre) - self.size1 - magnitude @ self.size2
        sides2 = jnp.abs(self.back) - self.size2 - magnitude.T @ self.size1
        faces = jnp.concatenate([sides1, sides2])
        face, face_gap = _largest(faces), jnp.max(faces)
        axes, regular = self._edge_axes()
        reach = jnp.abs(axes) @ self.size1 + jnp.abs(axes @ self.rot) @ self.size2
        gaps = jnp.where(regular, jnp.abs(axes @ self.centre) - reach, -jnp.inf)
        edges, gap = _largest(gaps), jnp.max(gaps)
        axis = jnp.sum(jnp.where(edges[..., None], axes, 0), axis=(0, 1))
        cosine = jnp.abs(jnp.concatenate([axis, axis @ self.rot]))
        aligned = jnp.sum(jnp.where(face, cosine, 0)) > ALIGNED
        bias = jnp.where(aligned, ALIGNED_BIAS, EDGE_BIAS)
        return face, edges, gap > face_gap + bias * jnp.abs(face_gap)

    def _edge_axes(self) -> tuple[Float[Array, "3 3 3"], Bool[Array, "3 3"]]:
        """Unit cross products of the first box's axes with the second's, and whether each is valid.

        Nearly parallel axes are not valid and not needed: their product is close to a face normal.
        """
        axes = jnp.cross(np.eye(3, dtype=self.rot.dtype)[:, None], self.rot.T[None])
        square = jnp.sum(axes**2, axis=-1)
        regular = square > max(1e-16, float(jnp.finfo(square.dtype).eps))
        length = jnp.sqrt(jnp.where(regular, square, 1))
        return axes / length[..., None], regular

    def edge_contact(self, edges: Bool[Array, "3 3"]):
        """Distance, point and normal at the closest points of the two supporting edges.

        With edges `c_i + x_i d_i`, e = c_2 - c_1 and b = d_1 . d_2:
        `x_1 = (d_1 . e - b d_2 . e) / (1 - b^2)`, then each is clipped in turn.
        """
        axes, _ = self._edge_axes()
        axis = jnp.sum(jnp.where(edges[..., None], axes, 0), axis=(0, 1))
        axis = jnp.where(axis @ self.centre < 0, -axis, axis)
        edge1, edge2 = jnp.any(edges, axis=1), jnp.any(edges, axis=0)
        corner1 = jnp.where(edge1, 0, jnp.where(axis >= 0, self.size1, -self.size1))
        corner2 = jnp.where(edge2, 0, jnp.where(axis @ self.rot >= 0, -self.size2, self.size2))
        corner2 = self.rot @ corner2 + self.centre
        along1 = jnp.where(edge1, 1, 0).astype(axis.dtype)
        along2 = self.rot @ jnp.where(edge2, 1, 0).astype(axis.dtype)
        length1, length2 = along1 @ self.size1, jnp.sum(jnp.where(edge2, self.size2, 0))
        between, cosine = corner2 - corner1, along1 @ along2
        across = jnp.cross(along1, along2)
        sine = across @ across
        x = jnp.cross(between, along2) @ across / jnp.where(sine > 0, sine, 1)
        x = jnp.clip(x, -length1, length1)
        y = jnp.clip(cosine * x - along2 @ between, -length2, length2)
        x = jnp.clip(along1 @ between + cosine * y, -length1, length1)
        point1, point2 = corner1 + along1 * x, corner2 + along2 * y
        return axis @ (point2 - point1), (point1 + point2) / 2, axis

    def face_contacts(self, face: Bool[Array, "6"]):
        """Distances and points at the corners of the intersection of two faces, and the normal.

        `face` is the reference face, and the opposing face of the other box is the incident face.
        In the axes x, y of the reference face and its outward normal z, both are parallelograms. A
        corner of their intersection at height z has distance z.
        """
        of_first = jnp.any(face[:3])
        normal = face[:3] | face[3:]
        axes = jnp.stack([jnp.roll(normal, 1), jnp.roll(normal, 2), normal]).astype(self.rot.dtype)
        size, other = (
            jnp.where(of_first, *pair)
            for pair in ((self.size1, self.size2), (self.size2, self.size1))
        )
        rot = axes @ jnp.where(of_first, self.rot, self.rot.T)
        centre = axes @ jnp.where(of_first, self.centre, -self.back)
        sign = jnp.where(centre[2] >= 0, 1, -1).astype(rot.dtype)
        opposing = _largest(jnp.abs(rot[2]))
        u, v, w = (rot @ jnp.where(jnp.roll(opposing, shift), other, 0) for shift in (1, 2, 0))
        lower = centre + jnp.where(sign * w[2] > 0, -w, w)
        upwards = jnp.stack([jnp.ones_like(sign), jnp.ones_like(sign), sign])
        lower, u, v, half = lower * upwards, u * upwards, v * upwards, axes @ size
        rectangle = jnp.asarray(_SQUARE, half.dtype) * half[None, :2]
        turned = jnp.where(u[0] * v[1] < u[1] * v[0], -v, v)
        parallelogram = (lower[None] + jnp.asarray(_SQUARE, half.dtype) @ jnp.stack([u, turned]))[
            :, :2
        ]
        points, exists = overlap_corners(rectangle, parallelogram, jnp.max(half))
        # Height of the incident face above a point of the reference face.
        height = _height(points, lower, u, v) - half[2]
        pos = jnp.concatenate([points, (sign * (half[2] + height / 2))[:, None]], axis=1) @ axes
        outward = jnp.where(of_first, 1, -1) * sign * axes[2]
        to_first = lambda x: jnp.where(of_first, x, x @ self.rot.T)  # noqa: E731
        pos = to_first(pos) + jnp.where(of_first, 0, self.centre)[None]
        return jnp.where(exists, height, INACTIVE), pos, to_first(outward)


def _height(points, origin, u, v):
    """Third component of the plane `origin + a u + b v`, at points given by the first two."""
    normal = jnp.cross(u, v)
    return origin[2] - (points - origin[:2][None]) @ (normal[:2] / normal[2])


def _largest(x: Float[Array, "..."]) -> Bool[Array, "..."]:
    """Mask of the largest element; the first among equals."""
    equal = (x == jnp.max(x)).ravel()
    return (equal & (jnp.cumsum(equal) == 1)).reshape(x.shape)
