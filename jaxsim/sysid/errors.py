"""The error of identification."""

from jaxsim.model import JaxsimError


class SysidError(JaxsimError, ValueError):
    """Data or parameters that cannot be fitted; the message says which and why."""

    summary = "{} things are wrong with what is to be fitted"
