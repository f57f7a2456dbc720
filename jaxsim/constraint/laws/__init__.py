"""Contact laws: the costs of contact rows. Each law is one file and one line in `LAWS`."""

from jaxsim.constraint.laws import hard, lagged, mujoco, sap
from jaxsim.constraint.laws.blur import Blur, blurred
from jaxsim.constraint.laws.combinations import ON_VELOCITIES, RIGID, check_law
from jaxsim.constraint.laws.law import ContactLaw, ContactState
from jaxsim.constraint.laws.material import Material, contact_material

# Laws by the names that `jaxsim.load(..., contact=name)` accepts.
LAWS: dict[str, ContactLaw] = {
    "mujoco": mujoco.contact_cost,
    "sap": sap.contact_cost,
    "lagged": lagged.contact_cost,
    "hard": hard.contact_cost,
}

__all__ = [
    "LAWS",
    "ON_VELOCITIES",
    "RIGID",
    "Blur",
    "ContactLaw",
    "ContactState",
    "Material",
    "blurred",
    "check_law",
    "contact_material",
]
