"""`Transcription`: an optimal control problem in which states are unknowns, too."""

from typing import Any, Protocol

from jaxtyping import Array, Float

from jaxsim.trajopt.problem import Problem


class Transcription(Protocol):
    """A problem as constraints and costs along a path.

    Each step t has an unknown position q_{t+1} in a space of tangent vectors (size,) and a control
    u_t. Constraints and costs of a step are about q_{t-1}, q_t, q_{t+1} and u_t.
    """

    @property
    def problem(self) -> Problem:
        """What is optimised."""
        ...

    @property
    def size(self) -> int:
        """Length of a tangent vector."""
        ...

    def cost(self, path: Any) -> Float[Array, ""]:
        """Cost of a path."""
        ...

    def moved(self, path: Any, step: Float[Array, "T n+nu"]) -> Any:
        """The path with other positions and controls."""
        ...

    def after(self, at: Any, path: Any, step: Float[Array, "T n+nu"]) -> Any:
        """The path after a step of an optimiser, which may know better than `moved`."""
        ...

    def gaps(self, path: Any) -> Float[Array, "T r"]:
        """Constraints, to be zero."""
        ...

    def gap_slopes(self, path: Any) -> tuple[Array, Array]:
        """Constraints, and their derivatives (T, r, 3 n + nu)."""
        ...

    def cost_expansion(self, path: Any) -> tuple[Array, Array, Array, Array]:
        """Gradients and Hessians of running costs, by q_{t-1}, q_t and u_t, and of the final."""
        ...
