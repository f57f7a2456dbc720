"""Whether the steps of a model are kernels, and the model whose derivatives are kernels, too."""

import dataclasses

from jaxsim.arrays.memo import is_traced
from jaxsim.lanes.switch import lanes_enabled
from jaxsim.model import Model


def steps_are_kernels(model: Model) -> bool:
    """Whether a step of this model becomes a kernel, which has to know all of its numbers."""
    return lanes_enabled() and not is_traced(model)


def reverse_only(model: Model) -> Model:
    """The model for a program that takes derivatives in reverse mode only, and once.

    Where its steps are kernels, so are their derivatives. Anywhere else it is the same model.
    """
    if not steps_are_kernels(model):
        return model
    return model.replace(backward=dataclasses.replace(model.backward, reverse_only=True))
