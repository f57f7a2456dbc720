"""What one reads off a moving tree: energy, momentum, wrenches and accelerations of bodies."""
