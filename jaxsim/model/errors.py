"""The errors that are jaxsim's own; wrong arguments are Python's ValueError and TypeError."""


class JaxsimError(Exception):
    """Base of all errors that are jaxsim's own.

    Each of them derives from a builtin error too, `ModelError` from `ValueError` for instance, and
    is made of one sentence for each thing that is wrong.
    """

    summary = "{} things are wrong"

    @property
    def problems(self) -> tuple[str, ...]:
        """One sentence for each thing that is wrong."""
        return tuple(str(problem) for problem in self.args)

    def __str__(self) -> str:
        """The problem, or a list of them."""
        if len(self.args) == 1:
            return self.problems[0]
        return "\n- ".join([self.summary.format(len(self.args)) + ":", *self.problems])


class ModelError(JaxsimError, ValueError):
    """A model asks for what is not supported, or its physics is invalid; the message names it."""

    summary = "{} things in the model are wrong or not supported"


def expect(value: object, kind: type, maker: str) -> None:
    """Raise a TypeError unless a value is of this type of ours; it says what makes one."""
    if not isinstance(value, kind):
        raise TypeError(
            f"expected a jaxsim.{kind.__name__}, got {type(value).__name__}; see {maker}"
        )
