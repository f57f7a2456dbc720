"""Three ways to solve with the Hessian `H = M + J^T W J` of the constraint problem.

- `articulated`: if no row couples two moving links, H is the mass matrix of the same tree with link
  inertias `I + G^T W G` and joint armatures `d + w`. The articulated body algorithm solves in O(n).
- `dense`: H as a matrix, from the composite rigid body algorithm and `J^T W J` of the rows that
  couple, and its Cholesky factor.
- `iterative`: conjugate gradients with O(n) products, preconditioned by the articulated solve
  without coupling.

The last two also use the articulated solve while no coupling contact is active in any environment
of the batch. If tendons have armature, M itself couples links, and solves with it are dense. All
vectors are in the order of the tree with compound joints (`jaxsim.model.compound`), which has fewer
links.
"""

import functools
from collections.abc import Iterable

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.batching.matrices import cholesky, cholesky_solve
from jaxsim.batching.primitives.decisions import any_in_batch
from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.contact_rows import ContactRows
from jaxsim.constraint.jacobian import DenseRows, Jacobian, LinkRows, add_products
from jaxsim.dynamics.aba import articulated_solve
from jaxsim.dynamics.components import (
    RestrictedInertia,
    motion_components,
    restrict,
    restrict_inertia,
)
from jaxsim.dynamics.crba import composite_matrix
from jaxsim.dynamics.free_bodies import own_axes, own_inertia, own_motion_axes
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.reflected import dof_armature
from jaxsim.dynamics.rnea import tree_force
from jaxsim.dynamics.tendons.inertia import has_tendon_inertia, tendon_inertia
from jaxsim.dynamics.tree import accumulate_outward
from jaxsim.lanes.switch import tracing_cpu_kernel
from jaxsim.model import Model
from jaxsim.model.dof_order import to_compound_order
from jaxsim.model.topology import Forest
from jaxsim.solver import LinearStatus, pcg_solve
from jaxsim.solver.operator import Rows
from jaxsim.spatial import Inertia

# Relative residual at which conjugate gradients end, in units of rounding.
_CG_ROUNDING = 10.0
# The preconditioned matrix has few distinct eigenvalues, so more iterations would not converge.
_CG_ITERATIONS = 200
# Contacts for which a kernel decides together whether their rows are needed.
_TOGETHER = 4

STRATEGIES = ("articulated", "dense", "iterative")


@struct.dataclass
class TreePoint:
    """A point x with linear functions of it that are needed more than once.

    Attributes:
      x: accelerations of the degrees of freedom.
      a: accelerations of the links.
      p: rates of the links' momenta, `I a`.
      rows: `J x`, one array for each block.
    """

    x: Float[Array, "nv"]
    a: Float[Array, "n c"]
    p: Float[Array, "n c"]
    rows: Rows


@struct.dataclass
class TreeOperator:
    """Products with M and J by recursions over the tree.

    Twists of links have the c components of `jaxsim.dynamics.components`.

    Attributes:
      cdof: motion axes.
      inertia: inertias of the links.
      armature: armature of the degrees of freedom.
      coupling: what armature of tendons adds to M; None if there is none.
      jacobians: Jacobian of each block.
      tree: the tree with compound joints, static.
      strategy: method of `solve`, one of `STRATEGIES`, static.
      occasional: whether contacts, and no other rows, may couple links, static.
    """

    cdof: Float[Array, "nv c"]
    inertia: Inertia | RestrictedInertia
    armature: Float[Array, "nv"]
    coupling: Float[Array, "nv nv"] | None
    jacobians: tuple[Jacobian, ...]
    tree: Forest = struct.field(pytree_node=False)
    strategy: str = struct.field(pytree_node=False)
    occasional: bool = struct.field(pytree_node=False)

    def lift(self, x: Float[Array, "nv"]) -> TreePoint:
        """The point x with the links' accelerations and momenta and the rows."""
        rate = sum_by(self.cdof * x[:, None], self.tree.dof_node, len(self.tree))
        return self.lift_known(x, accumulate_outward(self.tree, rate))

    def lift_known(self, x: Float[Array, "nv"], a: Float[Array, "n c"]) -> TreePoint:
        """`lift(x)` where the accelerations of the links are known."""
        momentum = jax.vmap(lambda inertia, a: inertia.apply(a))(self.inertia, a)
        return TreePoint(x, a, momentum, tuple(J.apply(x, a) for J in self.jacobians))

    def vector(self, y: TreePoint) -> Float[Array, "nv"]:
        """The point x of a lifted point."""
        return y.x

    def rows(self, y: TreePoint) -> Rows:
        """`J x`."""
        return y.rows

    def inner(self, y1: TreePoint, y2: TreePoint) -> Float[Array, ""]:
        """`x1^T M x2`, as a sum over links."""
        links = jnp.einsum("ij,ij->i", y1.a, y2.p)
        total = jnp.sum(links) + jnp.sum(self.armature * y1.x * y2.x)
        return total if self.coupling is None else total + y1.x @ self.coupling @ y2.x

    def residual(self, y: TreePoint, forces: Rows) -> Float[Array, "nv"]:
        """`J^T f - M x`."""
        own = -self.armature * y.x
        own = own if self.coupling is None else own - self.coupling @ y.x
        return self._on_dofs(forces, own, -y.p)

    def pull(self, forces: Rows) -> Float[Array, "nv"]:
        """`J^T f`."""
        nothing = jnp.zeros_like(self.cdof, shape=(len(self.tree), self.cdof.shape[1]))
        return self._on_dofs(forces, jnp.zeros_like(self.armature), nothing)

    def _on_dofs(self, forces: Rows, force: Float[Array, "nv"], wrench: Float[Array, "n c"]):
        """Generalised forces: `J^T f` plus `force` plus those of wrenches on the links."""
        for J, f in zip(self.jacobians, forces, strict=True):
            force, wrench = J.add_force(f, force, wrench)
        return force + tree_force(self.tree, self.cdof, wrench)

    def unconstrained(self, r: Float[Array, "nv"]) -> TreePoint:
        """`M^-1 r`, lifted."""
        if self.coupling is not None:
            return self.lift(cholesky_solve(factor(self._matrix(())), r))
        return self._solve_with((), r)

    def solve(
        self,
        curvatures: Rows,
        r: Float[Array, "nv"],
        enough: Float[Array, ""] | float = 0.0,
        spare: Float[Array, ""] | float = 0.0,
    ) -> tuple[TreePoint, LinearStatus]:
        """`(M + J^T W J)^-1 r`, lifted, and the status of the linear solve.

        An iterative solve may end where its relative residual is `enough`, or where what is left
        could lower the objective by about `spare`.
        """
        if self.strategy == "articulated" or not r.size:  # LAPACK has no empty factor
            return self._solve_articulated(curvatures, r)
        solve = self._solve_dense
        if self.strategy == "iterative":
            solve = functools.partial(self._solve_iteratively, enough=enough, spare=spare)
        if not self.occasional:
            return solve(curvatures, r)
        coupled = [W for J, W in zip(self.jacobians, curvatures, strict=True) if J.coupled]
        pushes = functools.reduce(jnp.logical_or, [jnp.any(W != 0) for W in coupled])
        return lax.cond(any_in_batch(pushes), solve, self._solve_articulated, curvatures, r)

    def _solve_articulated(self, curvatures: Rows, r) -> tuple[TreePoint, LinearStatus]:
        """`solve` without rows that couple."""
        pairs = zip(self.jacobians, curvatures, strict=True)
        return self._solve_with(((J, W) for J, W in pairs if not J.coupled), r), LinearStatus()

    def _solve_with(self, pairs: Iterable[tuple[Jacobian, Array]], r) -> TreePoint:
        """Solve with the matrix of `_uncoupled` by the articulated body algorithm."""
        matrix, diagonal = self._uncoupled(pairs)
        return self.lift_known(*articulated_solve(self.tree, self.cdof, matrix, diagonal, r))

    def _solve_dense(self, curvatures: Rows, r) -> tuple[TreePoint, LinearStatus]:
        pairs = zip(self.jacobians, curvatures, strict=True)
        x = cholesky_solve(factor(self._matrix(pairs)), r)
        return self.lift(x), LinearStatus()

    def _solve_iteratively(self, curvatures: Rows, r, enough, spare):
        matrix, diagonal = self._uncoupled(zip(self.jacobians, curvatures, strict=True))

        def precondition(force):
            return articulated_solve(self.tree, self.cdof, matrix, diagonal, force)[0]

        tolerance = jnp.maximum(_CG_ROUNDING * float(jnp.finfo(r.dtype).eps), enough)
        return pcg_solve(self, curvatures, r, precondition, tolerance, _CG_ITERATIONS, 2 * spare)

    def _matrix(self, pairs: Iterable[tuple[Jacobian, Array]]) -> Float[Array, "nv nv"]:
        """The matrix `M + J^T W J`; rows that couple are `DenseRows`, see `make_operator`."""
        pairs = list(pairs)
        coupled = [(J, W) for J, W in pairs if isinstance(J, DenseRows)]
        others = [(J, W) for J, W in pairs if not isinstance(J, DenseRows)]
        matrix, diagonal = self._uncoupled(others)
        H = composite_matrix(self.tree, self.cdof, RestrictedInertia(matrix), diagonal)
        H = H if self.coupling is None else H + self.coupling
        for J, W in coupled:
            H = add_products(H, J.J, W, rarely=self.occasional)
        return H

    def _uncoupled(self, pairs: Iterable[tuple[Jacobian, Array]]):
        """Link matrices and diagonal of `M + J^T W J` for these rows, without coupling terms."""
        matrix = jax.vmap(lambda inertia: inertia.as_matrix())(self.inertia)
        diagonal = self.armature
        for J, W in pairs:
            diagonal, matrix = J.add_curvature(W, diagonal, matrix)
        return matrix, diagonal


def make_operator(
    model: Model, kin: Kinematics, blocks: list[Block], strategy: str
) -> TreeOperator:
    """The operator of a model with these rows; `strategy` is one of `STRATEGIES`."""
    components, compound = motion_components(model), model.structure.compound
    cdof, inertia, jacobians = _in_own_axes(model, kin, [block.jacobian for block in blocks])
    cdof = take(restrict(components, cdof), compound.dof)
    jacobians = [J.restricted(components).renumbered(compound) for J in jacobians]
    if strategy == "dense":
        jacobians = [
            _dense_rows(J, block.kind.D, compound.tree, cdof) if J.coupled else J
            for J, block in zip(jacobians, blocks, strict=True)
        ]
    inertia = jax.tree.map(lambda x: take(x, compound.link), inertia)
    inertia = jax.vmap(lambda inertia: restrict_inertia(components, inertia))(inertia)
    armature = to_compound_order(model, dof_armature(model))
    coupled = {block.type for block in blocks if block.jacobian.coupled}
    coupling = None
    if has_tendon_inertia(model):
        coupling = tendon_inertia(model, kin)
        coupling = to_compound_order(model, to_compound_order(model, coupling).T)
    return TreeOperator(
        cdof,
        inertia,
        armature,
        coupling,
        tuple(jacobians),
        tree=compound.tree,
        strategy=strategy,
        occasional=coupled == {RowType.CONTACT} and coupling is None,
    )


def _in_own_axes(model: Model, kin: Kinematics, jacobians: list[Jacobian]):
    """Motion axes, inertias of the links and Jacobians, for twists in the axes of `own_axes`."""
    axes = own_axes(model, kin)
    if axes is None:
        return kin.cdof, kin.inertia, jacobians
    turned = [J.turned(axes) for J in jacobians]
    return own_motion_axes(model, kin, axes), own_inertia(model, kin), turned


def factor(H: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The lower Cholesky factor of H, or of H with a diagonal that is larger by rounding.

    Stiff contacts of a light body leave less of its weakest motions than rounding may take off. H
    is then not positive definite; `2 n eps diag(H)` outweighs what the factorisation rounds (Higham
    2002, "Accuracy and Stability of Numerical Algorithms", theorem 10.7).
    """
    found, diagonal = cholesky(H), jnp.diagonal(H)
    broken = ~jnp.isfinite(found[-1, -1]) & jnp.isfinite(jnp.sum(diagonal))

    def again(found, H):
        raised = H + jnp.diag(2 * len(H) * jnp.finfo(H.dtype).eps * diagonal)
        return jnp.where(broken, cholesky(raised), found)

    return lax.cond(any_in_batch(broken), again, lambda found, _: found, found, H)


def _dense_rows(J: Jacobian, D: Array, tree: Forest, cdof: Float[Array, "nv c"]) -> DenseRows:
    """The rows as a matrix, or zeros while no row is active (`D = 0`) in the whole batch.

    A kernel decides this for a few contacts at a time: the first slots are filled first.
    """
    if not (tracing_cpu_kernel() and isinstance(J, LinkRows | ContactRows)):
        return DenseRows(_dense_or_zeros(J, D, tree, cdof))
    parts = np.split(np.arange(len(D)), range(_TOGETHER, len(D), _TOGETHER))
    dense = [
        _dense_or_zeros(J.items(jnp.asarray(i)), D[i[0] : i[-1] + 1], tree, cdof) for i in parts
    ]
    return DenseRows(jnp.concatenate(dense))


def _dense_or_zeros(J: Jacobian, D: Array, tree: Forest, cdof: Float[Array, "nv c"]) -> Array:
    shape = jax.eval_shape(lambda cdof: J.dense(tree, cdof), cdof)
    return lax.cond(
        any_in_batch(jnp.any(D != 0)),
        lambda cdof: J.dense(tree, cdof),
        lambda _: jnp.zeros(shape.shape, shape.dtype),
        cdof,
    )
