"""Contact laws: the costs of contact rows. Each law is one file and one line in `LAWS`."""

from jaxsim.constraint.laws import mujoco
from jaxsim.constraint.laws.law import ContactLaw, ContactState

# Laws by the names that `jaxsim.load(..., contact=name)` accepts.
LAWS: dict[str, ContactLaw] = {
    "mujoco": mujoco.contact_cost,
}

__all__ = ["LAWS", "ContactLaw", "ContactState"]
