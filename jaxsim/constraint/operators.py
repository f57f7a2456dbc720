"""Three ways to solve with the Hessian `H = M + J^T W J` of the constraint problem.

`articulated`: without rows that couple two moving links, H is the mass matrix of the same tree
with link inertias `I + G^T W G` and joint armatures `d + w`; one walk in, one walk out, O(n).
`dense`: that mass matrix by composite bodies, `J^T W J` of the rows that couple, and Cholesky.
`iterative`: conjugate gradients on products that cost O(n), preconditioned by the articulated solve
that leaves the coupling out. The last two are articulated as well as long as no row that couples
pushes, anywhere in a batch. All vectors are in the order of the tree with compound joints
(`jaxsim.model.compound`), which has fewer links to walk over.
"""

import functools
from collections.abc import Iterable

import jax
import jax.numpy as jnp
from flax import struct
from jax import lax
from jax.scipy.linalg import cho_factor, cho_solve
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.batching.primitives.decisions import any_in_batch
from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.jacobian import DenseRows, Jacobian, add_products
from jaxsim.dynamics.aba import articulated_solve
from jaxsim.dynamics.components import (
    RestrictedInertia,
    motion_components,
    restrict,
    restrict_inertia,
)
from jaxsim.dynamics.crba import composite_matrix
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.rnea import tree_force
from jaxsim.dynamics.tree import accumulate_outward
from jaxsim.model import Model
from jaxsim.model.dof_order import to_compound_order
from jaxsim.model.topology import Forest
from jaxsim.solver import LinearStatus, pcg_solve
from jaxsim.solver.operator import Rows
from jaxsim.spatial import Inertia

# Conjugate gradients end when the residual has shrunk by this many units of rounding.
_CG_ROUNDING = 10.0
# The number of distinct eigenvalues is small; more iterations than this mean a hopeless system.
_CG_ITERATIONS = 200

STRATEGIES = ("articulated", "dense", "iterative")


@struct.dataclass
class TreePoint:
    """A point with all that is linear in it and needed more than once.

    Attributes:
      x: the point, accelerations of the degrees of freedom.
      a: the accelerations of the links that it causes.
      p: their momenta, `I a`.
      rows: `J x`, block by block.
    """

    x: Float[Array, "nv"]
    a: Float[Array, "n c"]
    p: Float[Array, "n c"]
    rows: Rows


@struct.dataclass
class TreeOperator:
    """Products with M and J by walks over the tree.

    Motions of links have the c components of `jaxsim.dynamics.components`.

    Attributes:
      cdof: motion axes.
      inertia: inertias of the links.
      armature: of the degrees of freedom.
      jacobians: one per block.
      tree: the links, joints of a body compounded, static.
      strategy: how `solve` does it, one of `STRATEGIES`, static.
      occasional: whether some rows couple, but only those of contacts, static.
    """

    cdof: Float[Array, "nv c"]
    inertia: Inertia | RestrictedInertia
    armature: Float[Array, "nv"]
    jacobians: tuple[Jacobian, ...]
    tree: Forest = struct.field(pytree_node=False)
    strategy: str = struct.field(pytree_node=False)
    occasional: bool = struct.field(pytree_node=False)

    def lift(self, x: Float[Array, "nv"]) -> TreePoint:
        """The point with the links' accelerations, momenta and its rows."""
        rate = sum_by(self.cdof * x[:, None], self.tree.dof_node, len(self.tree))
        return self.lift_known(x, accumulate_outward(self.tree, rate))

    def lift_known(self, x: Float[Array, "nv"], a: Float[Array, "n c"]) -> TreePoint:
        """`lift(x)` where the accelerations of the links are known."""
        momentum = jax.vmap(lambda inertia, a: inertia.apply(a))(self.inertia, a)
        return TreePoint(x, a, momentum, tuple(J.apply(x, a) for J in self.jacobians))

    def vector(self, y: TreePoint) -> Float[Array, "nv"]:
        """The point itself."""
        return y.x

    def rows(self, y: TreePoint) -> Rows:
        """`J x`."""
        return y.rows

    def inner(self, y1: TreePoint, y2: TreePoint) -> Float[Array, ""]:
        """`x1^T M x2`, link by link."""
        links = jnp.einsum("ij,ij->i", y1.a, y2.p)
        return jnp.sum(links) + jnp.sum(self.armature * y1.x * y2.x)

    def residual(self, y: TreePoint, forces: Rows) -> Float[Array, "nv"]:
        """`J^T f - M x`."""
        return self._on_dofs(forces, -self.armature * y.x, -y.p)

    def pull(self, forces: Rows) -> Float[Array, "nv"]:
        """`J^T f`."""
        nothing = jnp.zeros_like(self.cdof, shape=(len(self.tree), self.cdof.shape[1]))
        return self._on_dofs(forces, jnp.zeros_like(self.armature), nothing)

    def _on_dofs(self, forces: Rows, force: Float[Array, "nv"], wrench: Float[Array, "n c"]):
        """`J^T f` added to forces on the degrees of freedom and wrenches on the links."""
        for J, f in zip(self.jacobians, forces, strict=True):
            force, wrench = J.add_force(f, force, wrench)
        return force + tree_force(self.tree, self.cdof, wrench)

    def unconstrained(self, r: Float[Array, "nv"]) -> TreePoint:
        """The lifted `M^-1 r`."""
        return self._solve_with((), r)

    def solve(self, curvatures: Rows, r: Float[Array, "nv"]) -> tuple[TreePoint, LinearStatus]:
        """The lifted `(M + J^T W J)^-1 r`."""
        if self.strategy == "articulated" or not r.size:  # LAPACK has no empty factor
            return self._solve_articulated(curvatures, r)
        solve = self._solve_dense if self.strategy == "dense" else self._solve_iteratively
        if not self.occasional:
            return solve(curvatures, r)
        coupled = [W for J, W in zip(self.jacobians, curvatures, strict=True) if J.coupled]
        pushes = functools.reduce(jnp.logical_or, [jnp.any(W != 0) for W in coupled])
        return lax.cond(any_in_batch(pushes), solve, self._solve_articulated, curvatures, r)

    def _solve_articulated(self, curvatures: Rows, r) -> tuple[TreePoint, LinearStatus]:
        """Without the rows that couple, if there are any."""
        pairs = zip(self.jacobians, curvatures, strict=True)
        return self._solve_with(((J, W) for J, W in pairs if not J.coupled), r), LinearStatus()

    def _solve_with(self, pairs: Iterable[tuple[Jacobian, Array]], r) -> TreePoint:
        """`_uncoupled` solved by articulated bodies."""
        matrix, diagonal = self._uncoupled(pairs)
        return self.lift_known(*articulated_solve(self.tree, self.cdof, matrix, diagonal, r))

    def _solve_dense(self, curvatures: Rows, r) -> tuple[TreePoint, LinearStatus]:
        x = cho_solve(cho_factor(self._hessian(curvatures), lower=True), r)
        return self.lift(x), LinearStatus()

    def _solve_iteratively(self, curvatures: Rows, r) -> tuple[TreePoint, LinearStatus]:
        matrix, diagonal = self._uncoupled(zip(self.jacobians, curvatures, strict=True))

        def precondition(force):
            return articulated_solve(self.tree, self.cdof, matrix, diagonal, force)[0]

        tolerance = _CG_ROUNDING * float(jnp.finfo(r.dtype).eps)
        return pcg_solve(self, curvatures, r, precondition, tolerance, _CG_ITERATIONS)

    def _hessian(self, curvatures: Rows) -> Float[Array, "nv nv"]:
        """`M + J^T W J`; the rows that couple are `DenseRows`, see `make_operator`."""
        pairs = list(zip(self.jacobians, curvatures, strict=True))
        coupled = [(J, W) for J, W in pairs if isinstance(J, DenseRows)]
        others = [(J, W) for J, W in pairs if not isinstance(J, DenseRows)]
        matrix, diagonal = self._uncoupled(others)
        H = composite_matrix(self.tree, self.cdof, RestrictedInertia(matrix), diagonal)
        for J, W in coupled:
            H = add_products(H, J.J, W, rarely=self.occasional)
        return H

    def _uncoupled(self, pairs: Iterable[tuple[Jacobian, Array]]):
        """Link matrices and the diagonal of M with `J^T W J` of these rows, without coupling."""
        matrix = jax.vmap(lambda inertia: inertia.as_matrix())(self.inertia)
        diagonal = self.armature
        for J, W in pairs:
            diagonal, matrix = J.add_curvature(W, diagonal, matrix)
        return matrix, diagonal


def make_operator(
    model: Model, kin: Kinematics, blocks: list[Block], strategy: str
) -> TreeOperator:
    """The operator of a strategy from `STRATEGIES`."""
    components, compound = motion_components(model), model.structure.compound
    cdof = take(restrict(components, kin.cdof), compound.dof)
    jacobians = [block.jacobian.restricted(components).renumbered(compound) for block in blocks]
    if strategy == "dense":
        jacobians = [
            _dense_rows(J, block.kind.D, compound.tree, cdof) if J.coupled else J
            for J, block in zip(jacobians, blocks, strict=True)
        ]
    inertia = jax.tree.map(lambda x: take(x, compound.link), kin.inertia)
    inertia = jax.vmap(lambda inertia: restrict_inertia(components, inertia))(inertia)
    armature = to_compound_order(model, dof_armature(model))
    coupled = {block.type for block in blocks if block.jacobian.coupled}
    occasional = coupled == {RowType.CONTACT}
    tree = compound.tree
    return TreeOperator(cdof, inertia, armature, tuple(jacobians), tree, strategy, occasional)


def _dense_rows(J: Jacobian, D: Array, tree: Forest, cdof: Float[Array, "nv c"]) -> DenseRows:
    """The rows as a matrix; zeros where none of them, which D tells, can push anywhere."""
    shape = jax.eval_shape(lambda cdof: J.dense(tree, cdof), cdof)
    return DenseRows(
        lax.cond(
            any_in_batch(jnp.any(D != 0)),
            lambda cdof: J.dense(tree, cdof),
            lambda _: jnp.zeros(shape.shape, shape.dtype),
            cdof,
        )
    )
