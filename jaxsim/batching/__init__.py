"""`vmap` with the batch on the last axis: a traced program, evaluated for all lanes at once."""

from jaxsim.batching.mapping import vmap

__all__ = ["vmap"]
