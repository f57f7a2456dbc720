"""Derived quantities: energy, momentum, wrenches and accelerations of bodies, rays."""
