"""The errors of settings and of stored runs."""

from jaxsim.model import JaxsimError


class ConfigError(JaxsimError, ValueError):
    """Settings that do not exist or make no sense.

    Attributes:
      problems: one sentence for each of them.
    """

    def __init__(self, *problems: str):
        super().__init__(*problems)
        self.problems = problems

    def __str__(self) -> str:
        """The problem, or a list of them."""
        if len(self.problems) == 1:
            return str(self.problems[0])
        return "\n- ".join((f"{len(self.problems)} settings are wrong:", *self.problems))


class CheckpointError(JaxsimError, ValueError):
    """The directory of a run that cannot be written to, or lacks what is to be read from it."""
