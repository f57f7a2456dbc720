"""`vmap` with the batch on the last axis: evaluates a traced program for all lanes at once."""

from jaxsim.batching.mapping import vmap

__all__ = ["vmap"]
