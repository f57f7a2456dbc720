"""Rows of contacts: the relative motion of two links at a point, in the contact frame.

The Jacobian is not stored as a matrix, but as the contact frame and the lever arm of each link.
`J^T W J` is a sum of three 3x3 matrices for each link.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jaxtyping import Array, Float, Int

from jaxsim.arrays.indexing import gather_or_zero
from jaxsim.constraint.jacobian import LinkRows
from jaxsim.constraint.link_index import LinkIndex, add_at, items, moves
from jaxsim.dynamics.components import ALL, Components
from jaxsim.model.compound import Compound
from jaxsim.model.topology import Forest
from jaxsim.spatial import twist_at, wrench_from


@struct.dataclass
class Side:
    """One of the two links of each contact.

    Attributes:
      arm: (n, 3) contact point relative to the reference point of the link's tree, world axes (m).
      link: link of each contact.
      sign: 1 for the link of the second geom, -1 for that of the first, static.
    """

    arm: Float[Array, "n 3"]
    link: LinkIndex
    sign: float = struct.field(pytree_node=False)


@struct.dataclass
class ContactRows:
    """Rows of n contacts of the same dimension.

    The relative motion of two links at a contact has a normal, two sliding, one spinning and two
    rolling components in the contact frame; the first `condim` are rows.

    Attributes:
      frame: (n, 3, 3) rows are the normal and two tangents.
      sides: the sides of which some link may move.
      condim: number of components, static.
    """

    frame: Float[Array, "n 3 3"]
    sides: tuple[Side, ...]
    condim: int = struct.field(pytree_node=False)

    @property
    def coupled(self) -> bool:
        """Whether both links of a contact may move."""
        return len(self.sides) == 2

    def apply(self, x, a: Float[Array, "njnt 6"]) -> Float[Array, "n condim"]:
        """`J x`, from the accelerations `a` of the links."""
        parts = [
            s.sign * jax.vmap(twist_at)(gather_or_zero(a, s.link.index), s.arm) for s in self.sides
        ]
        return jax.vmap(self._components)(self.frame, sum(parts[1:], parts[0]))

    def add_force(self, f: Float[Array, "n condim"], force, wrench: Float[Array, "njnt 6"]):
        """Adds to the wrenches only."""
        pushes = jax.vmap(self._wrench)(self.frame, f)
        for s in self.sides:
            wrench = add_at(wrench, s.link, s.sign * jax.vmap(wrench_from)(pushes, s.arm))
        return force, wrench

    def add_curvature(self, W: Array, diagonal, matrix: Float[Array, "njnt 6 6"]):
        """Adds the terms of each side; W is diagonal or in blocks (n, condim, condim)."""
        if W.ndim == 2:
            W = jax.vmap(jnp.diag)(W)
        stiffness = jax.vmap(self._stiffness)(self.frame, W)
        for s in self.sides:
            blocks = jax.vmap(_shifted)(stiffness, s.arm)
            matrix = add_at(matrix, s.link, blocks, lambda blocks: _joined(*blocks))
        return diagonal, matrix

    def dense(self, tree: Forest, cdof: Float[Array, "nv 6"]) -> Float[Array, "n condim nv"]:
        """J as a matrix, tree order."""
        masks = [s.sign * moves(tree, s.link, cdof.dtype) for s in self.sides]
        arms = [s.arm for s in self.sides]
        if tree.nroot == 1:  # The links have the same reference point, so the same arms.
            masks, arms = [sum(masks[1:], masks[0])], arms[:1]
        maps = [self._map(arm) for arm in arms]
        parts = [(G @ cdof.T) * mask[:, None] for G, mask in zip(maps, masks, strict=True)]
        return sum(parts[1:], parts[0])

    def turned(self, axes: Float[Array, "njnt 3 3"]) -> LinkRows:
        """As `LinkRows`, because the frames of both sides are different then.

        Maps are also more accurate: with them `G^T W G` keeps the rank of W, where a stiffness that
        is moved by long arms may hide the inertia of a slender body about its axis.
        """
        sides = []
        for s in self.sides:
            turn = s.link.of_links(axes)
            arm = jax.vmap(jnp.matmul)(s.arm, turn)
            own = ContactRows(self.frame @ turn, (Side(arm, s.link, s.sign),), self.condim)
            sides += own._as_maps().sides
        return LinkRows(tuple(sides))

    def restricted(self, components: Components) -> "ContactRows | LinkRows":
        """As `LinkRows`, because maps from few components are smaller than frames and arms."""
        if components == ALL:
            return self
        return self._as_maps().restricted(components)

    def renumbered(self, compound: Compound) -> "ContactRows":
        """The same rows with the links renumbered."""
        sides = tuple(Side(s.arm, s.link.renumbered(compound.node), s.sign) for s in self.sides)
        return ContactRows(self.frame, sides, self.condim)

    def items(self, index: Int[Array, "k"]) -> "ContactRows":
        """The contacts at these indices."""
        sides = tuple(Side(items(s.arm, index), s.link.items(index), s.sign) for s in self.sides)
        return ContactRows(items(self.frame, index), sides, self.condim)

    def _as_maps(self) -> LinkRows:
        return LinkRows(tuple((s.sign * self._map(s.arm), s.link) for s in self.sides))

    def _map(self, arm: Float[Array, "n 3"]) -> Float[Array, "n condim 6"]:
        """Maps from a link's twist to the rows; their rows are the wrenches of unit forces."""
        about = jax.vmap(jax.vmap(wrench_from, in_axes=(0, None)))
        return about(jax.vmap(self._unit_wrenches)(self.frame), arm)

    def _components(self, frame, motion):
        """Row values of a twist (angular, linear) at the contact point."""
        linear = frame[: self.condim] @ motion[3:]
        if self.condim <= 3:
            return linear
        return jnp.concatenate([linear, frame[: self.condim - 3] @ motion[:3]])

    def _wrench(self, frame, force):
        """Transpose of `_components`: (torque, force) at the contact point."""
        push = force[:3] @ frame[: self.condim]
        spin = force[3:] @ frame[: self.condim - 3] if self.condim > 3 else jnp.zeros_like(push)
        return jnp.concatenate([spin, push])

    def _unit_wrenches(self, frame):
        """(condim, 6) wrenches of a unit force along each row, at the contact point."""
        F = frame[: self.condim]
        pushes = jnp.concatenate([jnp.zeros_like(F), F], axis=1)
        if self.condim <= 3:
            return pushes
        A = frame[: self.condim - 3]
        return jnp.concatenate([pushes, jnp.concatenate([A, jnp.zeros_like(A)], axis=1)])

    def _stiffness(self, frame, W):
        """Linear, mixed and angular 3x3 blocks of `C^T W C`, where C is the map `_components`."""
        F = frame[: self.condim]
        linear = F.T @ (W[:3, :3] @ F)
        if self.condim <= 3:
            return linear, None, None
        A = frame[: self.condim - 3]
        return linear, A.T @ (W[3:, :3] @ F), A.T @ (W[3:, 3:] @ A)


def contact_rows(frame, condim: int, arms, links) -> ContactRows:
    """Rows of contacts, without sides that never move.

    Args:
      frame: (n, 3, 3) contact frames.
      condim: dimension of the contacts.
      arms: contact points relative to the reference points of the first and of the second links.
      links: first and second links in tree order, -1 for none; NumPy arrays if static.
    """
    sides = [
        Side(arm, LinkIndex.of(link), sign)
        for arm, link, sign in zip(arms, links, (-1.0, 1.0), strict=True)
    ]
    moving = [side for side in sides if side.link.may_move]
    return ContactRows(frame, tuple(moving or sides[1:]), condim)


def _shifted(stiffness, arm):
    """Blocks (upper, lower, linear) of a stiffness about the reference point.

    From the linear block K, the mixed block B and the angular block A at the contact point, and the
    matrix X of `omega -> omega x arm`: `X^T K X + B X + (B X)^T + A`, `K X + B^T` and `K`.
    """
    linear, mixed, angular = stiffness
    lower = jnp.cross(arm[None], linear)  # K X; its rows are arm x the rows of K
    if mixed is not None:
        lower = lower + mixed.T
    lower = lax.optimization_barrier(lower)  # used twice: XLA would compute it twice
    upper = jnp.cross(arm[:, None], lower, axis=0)
    if mixed is not None:
        upper = upper + jnp.cross(arm[None], mixed) + angular
    return upper, lower, linear


def _joined(upper, lower, linear):
    """The symmetric 6x6 matrix of three blocks."""
    top = jnp.concatenate([upper, lower.T], axis=1)
    return jnp.concatenate([top, jnp.concatenate([lower, linear], axis=1)])
