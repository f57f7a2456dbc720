"""Plots: of trajectories, of plans, of fits and of learning."""
