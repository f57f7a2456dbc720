"""The error of a model that cannot be built."""


class ModelError(ValueError):
    """A model asks for what is not supported, or its physics is invalid; the message names it."""
