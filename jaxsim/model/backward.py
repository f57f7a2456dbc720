"""`Backward`: what derivatives through contact are to mean, where it differs from the program's."""

import dataclasses
import math


@dataclasses.dataclass(frozen=True)
class Backward:
    """Options for the derivatives of a step; none of them changes its values.

    With the defaults, derivatives are those of the program: the limit of differences of its values.
    `docs/gradients.md` says when that is not what one wants, and derives the options.

    Attributes:
      entry_time: whether to add the derivative of the times at which contacts and limits begin to
        act. The program's steps do not depend on them, but the continuous motion does.
      distance: in derivatives, contacts act from this distance on (m), with an impedance that rises
        from zero there.
      softening: in derivatives, time constants of contacts are longer by this factor.
      reverse_only: derivatives are taken in reverse mode only, and once. A step's derivative is
        then a kernel, where steps are (`docs/lanes.md`).

    Raises:
      ValueError: a number is out of range, or `entry_time` is combined with other options, which
        have other entry times.
    """

    entry_time: bool = False
    distance: float = 0.0
    softening: float = 1.0
    reverse_only: bool = False

    def __post_init__(self):
        if not (math.isfinite(self.distance) and self.distance >= 0):
            raise ValueError(f"distance must be a length, got {self.distance}")
        if not (math.isfinite(self.softening) and self.softening >= 1):
            raise ValueError(f"softening must be at least 1, got {self.softening}")
        if self.entry_time and self.smooths:
            raise ValueError("entry_time does not combine with distance or softening")

    @property
    def smooths(self) -> bool:
        """Whether derivatives are those of softer contacts."""
        return self.distance > 0 or self.softening > 1


EXACT = Backward()
