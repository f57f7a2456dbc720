"""Forces that a model has or has not, decided when it is loaded.

What a model does not have is left out of the compiled program. Their numbers are leaves like all
others, so a model that is to be changed later should be loaded with a number that is not zero.
"""

import mujoco
import numpy as np


def features(mj: mujoco.MjModel) -> dict[str, bool | tuple[int, ...]]:
    """Static flags of forces that few models have and that cost a walk over the tree.

    Args:
      mj: a compiled model.

    Returns:
      `has_fluid`: density or viscosity is not zero; `has_gravcomp`: some body has gravity
      compensation; `has_tendon_damping`: some tendon, or an actuator of one, has damping;
      `friction_dofs`, `friction_tendons`: those with dry friction.
    """
    on_tendon = mj.actuator_trntype == int(mujoco.mjtTrn.mjTRN_TENDON)
    damping = (
        mj.tendon_damping,
        mj.tendon_dampingpoly,
        mj.actuator_damping[on_tendon],
        mj.actuator_dampingpoly[on_tendon],
    )
    return {
        "has_fluid": bool(mj.opt.density or mj.opt.viscosity),
        "has_gravcomp": bool(np.any(mj.body_gravcomp)),
        "has_tendon_damping": any(bool(np.any(d)) for d in damping),
        "friction_dofs": tuple(np.nonzero(mj.dof_frictionloss > 0)[0].tolist()),
        "friction_tendons": tuple(np.nonzero(mj.tendon_frictionloss > 0)[0].tolist()),
    }
