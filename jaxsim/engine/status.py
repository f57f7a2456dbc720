"""`Status`: the status of the constraint solves of one or of several time steps."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float, Int

from jaxsim.constraint import Constrained


@struct.dataclass
class Status:
    """Status of constraint solves as data; `jaxsim.check` raises an error for problems in it.

    Attributes:
      iterations: total number of Newton steps.
      converged: False if a solve ran out of iterations; models may ask for as few as one.
      cg_iterations: total number of iterations of conjugate gradients; zero if they are not used.
      cg_converged: False if conjugate gradients ran out of iterations.
      residual: largest norm of the objective's gradient at a solution; derivatives are accurate
        only if it is small.
      finite: False if some numbers are not finite.
      passes: total number of solves by which hard contacts and friction without creep were found.
      rigid_residual: largest change of their forces by another pass, relative to the largest force.
      contact_overflow: largest number of contacts at one time that were lost for lack of slots.
    """

    iterations: Int[Array, ""]
    converged: Bool[Array, ""]
    cg_iterations: Int[Array, ""]
    cg_converged: Bool[Array, ""]
    residual: Float[Array, ""]
    finite: Bool[Array, ""]
    passes: Int[Array, ""]
    rigid_residual: Float[Array, ""]
    contact_overflow: Int[Array, ""]

    @classmethod
    def of(cls, found: Constrained) -> "Status":
        """The status of one solve."""
        solver = found.status
        return cls(
            iterations=solver.iterations,
            converged=solver.converged,
            cg_iterations=jnp.asarray(solver.linear.iterations),
            cg_converged=jnp.asarray(solver.linear.converged),
            residual=solver.residual,
            finite=jnp.all(jnp.isfinite(found.qacc)),
            passes=jnp.asarray(solver.passes),
            rigid_residual=jnp.asarray(solver.rigid_residual, solver.residual.dtype),
            contact_overflow=found.contact.overflow.astype(jnp.int32),
        )

    @classmethod
    def empty(cls, dtype) -> "Status":
        """The status before the first solve; `dtype` is the type of the residuals."""
        zero, yes, none = jnp.zeros((), jnp.int32), jnp.ones((), bool), jnp.zeros((), dtype)
        return cls(zero, yes, zero, yes, none, yes, zero, none, zero)

    def then(self, later: "Status") -> "Status":
        """The combined status of these solves and of later ones."""
        return Status(
            iterations=self.iterations + later.iterations,
            converged=self.converged & later.converged,
            cg_iterations=self.cg_iterations + later.cg_iterations,
            cg_converged=self.cg_converged & later.cg_converged,
            residual=jnp.maximum(self.residual, later.residual),
            finite=self.finite & later.finite,
            passes=self.passes + later.passes,
            rigid_residual=jnp.maximum(self.rigid_residual, later.rigid_residual),
            contact_overflow=jnp.maximum(self.contact_overflow, later.contact_overflow),
        )
