"""Whether the steps of a model are kernels, and the model whose derivatives are kernels, too."""

import dataclasses

import jax

from jaxsim.arrays.memo import is_traced
from jaxsim.lanes.switch import lanes_enabled
from jaxsim.model import Model


def steps_are_kernels(model: Model) -> bool:
    """Whether a step of this model becomes a kernel, which has to know all of its numbers."""
    return lanes_enabled() and not is_traced(model)


def reverse_only(model: Model) -> Model:
    """The model for a program that takes derivatives in reverse mode only, and once.

    Where its steps are kernels on a CPU, so are their derivatives. Anywhere else it is the same
    model: a GPU's driver would take minutes to compile a kernel of this size.
    """
    if jax.default_backend() != "cpu" or not steps_are_kernels(model):
        return model
    return model.replace(backward=dataclasses.replace(model.backward, reverse_only=True))
