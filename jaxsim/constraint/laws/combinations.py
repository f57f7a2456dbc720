"""What a law of contact does not go together with."""

import mujoco

from jaxsim.model import Model, ModelError
from jaxsim.model.enums import constant_name

# Laws on the velocity after a step of semi-implicit Euler. Joints' implicit damping is part of it.
ON_VELOCITIES = frozenset({"sap", "lagged", "hard"})
# Laws whose rows have no regularisation in the end.
RIGID = frozenset({"hard"})

_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_OVERRIDE = mujoco.mjtEnableBit.mjENBL_OVERRIDE


def check_law(model: Model) -> None:
    """Raises a `ModelError` that names what does not combine with the model's law of contact."""
    if model.contact not in ON_VELOCITIES:
        return
    law = f"contact={model.contact!r}"
    if model.opt.integrator != _EULER:
        name = constant_name("mjtIntegrator", model.opt.integrator)
        raise ModelError(
            f"{law} needs integrator 'Euler', and the model has {name!r}; it is a law on the "
            "velocity after a step"
        )
    if model.opt.noslip_iterations:
        raise ModelError(f"{law} does not combine with noslip_iterations; set them to 0")
    if model.flg_adhesion:
        raise ModelError(f"{law} does not combine with adhesion of geoms or pairs; set it to 0")
    if model.opt.enabled(_OVERRIDE):
        raise ModelError(f"{law} does not combine with the flag 'override'; disable it")
