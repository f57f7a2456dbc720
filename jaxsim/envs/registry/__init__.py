"""Environments by name: the entries, their options, and what their docstrings say."""

from jaxsim.envs.registry.entries import Spec, make, names, on_register, register, spec

__all__ = ["Spec", "make", "names", "on_register", "register", "spec"]
