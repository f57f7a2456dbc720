"""Pair functions: one for each pair of shapes, one file for each family."""
