"""Batches: `vmap` with the batch last, chunks and devices."""

from jaxsim.batch.vmap import vmap

__all__ = ["vmap"]
