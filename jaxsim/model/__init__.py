"""Models and states: what is simulated, and where it is."""

from jaxsim.model.build import build
from jaxsim.model.errors import ModelError
from jaxsim.model.model import Model, Option
from jaxsim.model.names import Names
from jaxsim.model.state import State, make_state
from jaxsim.model.structure import Structure

__all__ = [
    "Model",
    "ModelError",
    "Names",
    "Option",
    "State",
    "Structure",
    "build",
    "make_state",
    "set_const",
]


def set_const(model: Model) -> Model:
    """Recompute the derived constants after masses, sizes or poses have changed.

    See `jaxsim.dynamics.constants.set_const`, which needs the dynamics and therefore lives above
    this layer.
    """
    from jaxsim.dynamics.constants import set_const as compute

    return compute(model)
