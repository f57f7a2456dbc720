"""`Status`: how the solves of one or of many time steps went."""

import jax.numpy as jnp
from flax import struct
from jaxtyping import Array, Bool, Float, Int

from jaxsim.constraint import Constrained


@struct.dataclass
class Status:
    """Trouble as data; `jaxsim.check` turns it into a message.

    Attributes:
      iterations: Newton steps taken, by all solves together.
      converged: False if a solve ran out of iterations; a model may ask for as few as one.
      cg_iterations: iterations of conjugate gradients within the Newton steps, all together; zero
        for solves that need none.
      cg_converged: False if conjugate gradients ran out of iterations.
      residual: norm of the objective's gradient at the solution, the largest; derivatives are wrong
        where it is not small.
      finite: False if numbers are not finite.
      contact_overflow: contacts that found no slot, the most at one time.
    """

    iterations: Int[Array, ""]
    converged: Bool[Array, ""]
    cg_iterations: Int[Array, ""]
    cg_converged: Bool[Array, ""]
    residual: Float[Array, ""]
    finite: Bool[Array, ""]
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
            contact_overflow=found.contact.overflow.astype(jnp.int32),
        )

    @classmethod
    def empty(cls, dtype) -> "Status":
        """The status before the first solve, with residuals of a type."""
        zero, yes = jnp.zeros((), jnp.int32), jnp.ones((), bool)
        return cls(zero, yes, zero, yes, jnp.zeros((), dtype), yes, zero)

    def then(self, later: "Status") -> "Status":
        """The status of these solves and later ones together."""
        return Status(
            iterations=self.iterations + later.iterations,
            converged=self.converged & later.converged,
            cg_iterations=self.cg_iterations + later.cg_iterations,
            cg_converged=self.cg_converged & later.cg_converged,
            residual=jnp.maximum(self.residual, later.residual),
            finite=self.finite & later.finite,
            contact_overflow=jnp.maximum(self.contact_overflow, later.contact_overflow),
        )
