"""Rigid-body simulation in JAX."""
