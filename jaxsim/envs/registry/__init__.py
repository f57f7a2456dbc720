"""The registry of environments by name, with their options and documentation."""

from jaxsim.envs.registry.entries import Spec, make, names, on_register, register, spec

__all__ = ["Spec", "make", "names", "on_register", "register", "spec"]
