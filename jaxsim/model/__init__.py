"""`Model` and `State`: the parameters of a robot and its world, and their state."""

from jaxsim.model.errors import JaxsimError, ModelError
from jaxsim.model.model import Model, Option
from jaxsim.model.names import Names
from jaxsim.model.state import State, make_state
from jaxsim.model.structure import Structure

__all__ = [
    "JaxsimError",
    "Model",
    "ModelError",
    "Names",
    "Option",
    "State",
    "Structure",
    "make_state",
]
