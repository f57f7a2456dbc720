"""The errors of settings and of stored runs."""

from jaxsim.model import JaxsimError


class ConfigError(JaxsimError, ValueError):
    """Settings that are unknown or invalid."""

    summary = "{} settings are wrong"


class CheckpointError(JaxsimError, ValueError):
    """The directory of a run cannot be written to, or does not contain what is to be read."""
