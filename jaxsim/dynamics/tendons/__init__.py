"""Tendons: their paths, lengths, moment arms and inertia."""
