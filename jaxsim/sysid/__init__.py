"""System identification: numbers of a model from recorded trajectories."""

from jaxsim.sysid.confidence import Combination
from jaxsim.sysid.errors import SysidError
from jaxsim.sysid.fitting import Fit, fit
from jaxsim.sysid.parameters import Parameter
from jaxsim.sysid.recording import Recording, read_csv, read_npz

__all__ = [
    "Combination",
    "Fit",
    "Parameter",
    "Recording",
    "SysidError",
    "fit",
    "read_csv",
    "read_npz",
]
