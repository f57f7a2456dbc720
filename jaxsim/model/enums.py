"""Names of MuJoCo's constants."""

import mujoco


def constant_name(enum: str, value: int) -> str:
    """Name of a constant without its prefix, or "number N" if this MuJoCo has no such constant.

    Example:
      >>> constant_name("mjtGeom", 3)
      'CAPSULE'
    """
    for name, known in getattr(mujoco, enum).__members__.items():
        if int(known) == int(value):
            return name.partition("_")[2]
    return f"number {int(value)}"
