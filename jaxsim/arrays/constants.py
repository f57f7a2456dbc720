"""Numbers of MuJoCo, by its names less `mj`."""

import mujoco

# What is smaller counts as zero: masses, lengths, time constants, denominators.
MINVAL = float(mujoco.mjMINVAL)
# Friction coefficients are at least this.
MINMU = float(mujoco.mjMINMU)
# The impedance of a constraint is between these.
MINIMP, MAXIMP = float(mujoco.mjMINIMP), float(mujoco.mjMAXIMP)
