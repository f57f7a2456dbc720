"""Where states live: how to move one by a tangent vector, and which vector leads to another."""

import dataclasses
from typing import Any, Protocol

import jax
import jax.numpy as jnp
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

from jaxsim.joints.coordinates import difference_pos, integrate_pos
from jaxsim.model import Model, State


class Space(Protocol):
    """States x and their tangent vectors dx, shape (size,).

    `retract(x, 0)` is x, and `difference(x, retract(x, dx))` is dx for small dx.
    """

    @property
    def size(self) -> int:
        """Length of a tangent vector."""
        ...

    def retract(self, x: Any, dx: Float[Array, "n"]) -> Any:
        """The state that dx leads to from x."""
        ...

    def difference(self, x: Any, y: Any) -> Float[Array, "n"]:
        """The tangent vector that leads from x to y."""
        ...


@dataclasses.dataclass(frozen=True)
class VectorSpace:
    """States that are arrays, or pytrees of arrays, and are added number by number.

    Attributes:
      size: how many numbers a state has.
    """

    size: int

    def retract(self, x: Any, dx: Float[Array, "n"]) -> Any:
        """`x + dx`."""
        flat, unravel = ravel_pytree(x)
        return unravel(flat + dx)

    def difference(self, x: Any, y: Any) -> Float[Array, "n"]:
        """`y - x`."""
        return ravel_pytree(y)[0] - ravel_pytree(x)[0]


@dataclasses.dataclass(frozen=True)
class StateSpace:
    """States of a model; dx is (change of position, of `qvel`, of `act`).

    Positions change along the joints' own directions, as in `mj_integratePos`, so that quaternions
    have three of them. What a user applies, and the time, are not part of dx.

    Attributes:
      model: the model.
    """

    model: Model

    @property
    def size(self) -> int:
        """`2 nv + na`."""
        return 2 * self.model.nv + self.model.na

    def retract(self, x: State, dx: Float[Array, "n"]) -> State:
        """Positions moved along the joints, velocities and activations by addition."""
        nv = self.model.nv
        return x.replace(
            qpos=integrate_pos(self.model, x.qpos, dx[:nv], 1.0),
            qvel=x.qvel + dx[nv : 2 * nv],
            act=x.act + dx[2 * nv :],
        )

    def difference(self, x: State, y: State) -> Float[Array, "n"]:
        """The inverse of `retract`."""
        moved = difference_pos(self.model, x.qpos, y.qpos)
        return jnp.concatenate([moved, y.qvel - x.qvel, y.act - x.act])


def stack(first: Any, rest: Any) -> Any:
    """States (T+1, ...) from the first one and (T, ...) others."""
    return jax.tree.map(lambda a, b: jnp.concatenate([a[None], b]), first, rest)
