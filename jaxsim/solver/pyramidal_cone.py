"""Contacts with pyramidal friction cones.

A contact has d rows: the normal, then d - 1 directions of friction. The pyramid has two edges for
each direction,

    e = r[0] + mu[j] r[j]   and   e = r[0] - mu[j] r[j],

and each edge may only push, with cost `1/2 D min(e, 0)^2` (MuJoCo documentation, "Computation").
The edges are the rows in MuJoCo. Here the normal and the directions of friction are the rows, as
for an elliptic cone: these are d rows, not 2 (d - 1), and their forces are the contact force.
"""

import jax
import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float

from jaxsim.solver.unilateral import change_of_square


@struct.dataclass
class PyramidalCone:
    """Cost of n contacts of the same dimension d in {3, 4, 6}.

    Attributes:
        aref: Reference acceleration; the residual is `r = J x - aref`. Normal first.
        D: Inverse regularisation `1 / R >= 0` of every edge. A contact with `D = 0` contributes
            nothing.
        mu: Friction coefficients of the rows 1 to d - 1, `>= 0`.
    """

    aref: Float[Array, "n d"]
    D: Float[Array, "n"]
    mu: Float[Array, "n d-1"]

    def cost(self, r: Float[Array, "n d"]) -> Float[Array, ""]:
        """Total cost of the contacts at the residual r."""
        plus, minus = (jnp.minimum(e, 0) for e in self._edges(r))
        return 0.5 * jnp.sum(self.D[:, None] * (plus * plus + minus * minus))

    def force(self, r: Float[Array, "n d"]) -> Float[Array, "n d"]:
        """Force `-ds/dr` of every contact, inside its friction pyramid."""
        plus, minus = (-self.D[:, None] * jnp.minimum(e, 0) for e in self._edges(r))
        normal = jnp.sum(plus + minus, axis=1, keepdims=True)
        return jnp.concatenate([normal, self.mu * (plus - minus)], axis=1)

    def curvature(self, r: Float[Array, "n d"]) -> Float[Array, "n d d"]:
        """Hessian of the cost of every contact, positive semidefinite."""
        plus, minus = self._stiffness(self._edges(r))
        total = plus + minus
        mixed = self.mu * (plus - minus)
        top = jnp.concatenate([jnp.sum(total, axis=1, keepdims=True), mixed], axis=1)
        rest = jax.vmap(jnp.diag)(self.mu * self.mu * total)
        below = jnp.concatenate([mixed[:, :, None], rest], axis=2)
        return jnp.concatenate([top[:, None], below], axis=1)

    def slopes(
        self, r: Float[Array, "n d"], v: Float[Array, "n d"]
    ) -> tuple[Float[Array, ""], Float[Array, ""]]:
        """First and second derivative of the cost at r along v."""
        edges, speeds = self._edges(r), self._edges(v)
        dv = [w * u for w, u in zip(self._stiffness(edges), speeds, strict=True)]
        first = dv[0] * edges[0] + dv[1] * edges[1]
        second = dv[0] * speeds[0] + dv[1] * speeds[1]
        return jnp.sum(first), jnp.sum(second)

    def change(self, r: Float[Array, "n d"], step: Float[Array, "n d"]) -> Float[Array, ""]:
        """`cost(r + step) - cost(r)` without the cancellation of that difference."""
        plus, minus = map(change_of_square, self._edges(r), self._edges(step))
        return 0.5 * jnp.sum(self.D[:, None] * (plus + minus))

    def is_quadratic(self, r: Float[Array, "n d"], end: Float[Array, "n d"]) -> Bool[Array, ""]:
        """Whether no edge changes zone from r to end."""
        before, after = self._stiffness(self._edges(r)), self._stiffness(self._edges(end))
        return jnp.all((before[0] == after[0]) & (before[1] == after[1]))

    def normals(self, r: Float[Array, "n d"]) -> Float[Array, "n d-1"]:
        """Sum of the normal forces of both edges of each direction, which limits its friction."""
        plus, minus = (-self.D[:, None] * jnp.minimum(e, 0) for e in self._edges(r))
        return plus + minus

    def edges(self, r: Float[Array, "n d"]) -> Float[Array, "n 2*(d-1)"]:
        """Residuals of the edges in MuJoCo's order: both of one direction, then of the next."""
        return jnp.stack(self._edges(r), axis=2).reshape(r.shape[0], -1)

    def spread(self, force: Float[Array, "n d"]) -> Float[Array, "n 2*(d-1)"]:
        """Forces of the edges, in the same order, that add up to the forces of the rows.

        The part of the normal force that friction does not need is spread evenly.
        """
        needed = jnp.where(self.mu > 0, force[:, 1:] / jnp.where(self.mu > 0, self.mu, 1.0), 0.0)
        surplus = force[:, 0] - jnp.sum(jnp.abs(needed), axis=1)
        total = jnp.abs(needed) + surplus[:, None] / needed.shape[1]
        edges = jnp.stack([total + needed, total - needed], axis=2) / 2
        return edges.reshape(force.shape[0], -1)

    def _edges(self, r):
        """Residuals (n, d - 1) of the edges e on the positive and the negative side."""
        tangent = self.mu * r[:, 1:]
        return r[:, :1] + tangent, r[:, :1] - tangent

    def _stiffness(self, edges):
        """Second derivatives of the cost along the edges."""
        return [jnp.where(e < 0, self.D[:, None], 0.0) for e in edges]
