"""Where the compiler's fusion ends.

XLA computes an operand again in every operation that it fuses with, which for a chain grows
exponentially. On a CPU a call that is not inlined is computed once; the optimisation barrier is no
help, as it is removed before operations are fused.
"""

import jax
from jax.experimental.xla_metadata import set_xla_metadata


def not_inlined():
    """A context in which calls of compiled functions stay calls."""
    return set_xla_metadata(inlineable="false")


@jax.custom_jvp
def computed(x):
    """The same `x`, computed before it is used."""
    with not_inlined():
        return _identity(x)


@computed.defjvp
def _computed_jvp(primals, tangents):
    return computed(*primals), tangents[0]


@jax.jit
def _identity(x):
    return x
