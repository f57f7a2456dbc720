"""The errors that are jaxsim's own; wrong arguments are Python's ValueError and TypeError."""


class JaxsimError(Exception):
    """Base of all errors that are jaxsim's own.

    Each of them derives from a builtin error too, `ModelError` from `ValueError` for instance.
    """


class ModelError(JaxsimError, ValueError):
    """A model asks for what is not supported, or its physics is invalid; the message names it."""
