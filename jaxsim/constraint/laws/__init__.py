"""Contact laws: what the rows of a contact cost. One file for each law, one line in `LAWS`."""

from jaxsim.constraint.laws import mujoco
from jaxsim.constraint.laws.law import ContactLaw, ContactState

# By the name that `jaxsim.load(..., contact=name)` takes.
LAWS: dict[str, ContactLaw] = {
    "mujoco": mujoco.contact_cost,
}

__all__ = ["LAWS", "ContactLaw", "ContactState"]
