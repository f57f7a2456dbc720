"""MuJoCo's constants, by its names without the prefix `mj`."""

import mujoco

# Smaller masses, lengths, time constants and denominators are treated as zero.
MINVAL = float(mujoco.mjMINVAL)
# Friction coefficients are at least this.
MINMU = float(mujoco.mjMINMU)
# The impedance of a constraint is between these.
MINIMP, MAXIMP = float(mujoco.mjMINIMP), float(mujoco.mjMAXIMP)
