"""jaxsim's own errors; wrong arguments raise Python's ValueError and TypeError."""


class JaxsimError(Exception):
    """Base class of jaxsim's own errors.

    Each subclass derives from a builtin error, too, as `ModelError` does from `ValueError`. Its
    arguments are one sentence for each problem.
    """

    summary = "{} things are wrong"

    @property
    def problems(self) -> tuple[str, ...]:
        """One sentence for each problem."""
        return tuple(str(problem) for problem in self.args)

    def __str__(self) -> str:
        """The problem, or a list of all problems."""
        if len(self.args) == 1:
            return self.problems[0]
        return "\n- ".join([self.summary.format(len(self.args)) + ":", *self.problems])


class ModelError(JaxsimError, ValueError):
    """A model uses unsupported features or has impossible physics; the message says where."""

    summary = "{} things in the model are wrong or not supported"


def expect(value: object, kind: type, maker: str) -> None:
    """Raise a TypeError unless `value` is an instance of `kind`; it refers to `maker`."""
    if not isinstance(value, kind):
        raise TypeError(
            f"expected a jaxsim.{kind.__name__}, got {type(value).__name__}; see {maker}"
        )
