"""The errors of settings and of stored runs."""

from jaxsim.model import JaxsimError


class ConfigError(JaxsimError, ValueError):
    """Settings that do not exist or make no sense."""

    summary = "{} settings are wrong"


class CheckpointError(JaxsimError, ValueError):
    """The directory of a run that cannot be written to, or lacks what is to be read from it."""
