"""A block of constraint rows: what they are, their cost and their Jacobian."""

import enum

from flax import struct
from jaxtyping import Array, Float

from jaxsim.constraint.jacobian import Jacobian
from jaxsim.solver import Kind


class RowType(enum.Enum):
    """What a row holds in place. The values are for messages."""

    CONNECT = "connect equality"
    WELD = "weld equality"
    JOINT = "joint equality"
    TENDON = "tendon equality"
    FRICTION_DOF = "joint friction"
    FRICTION_TENDON = "tendon friction"
    LIMIT_JOINT = "joint limit"
    LIMIT_TENDON = "tendon limit"
    CONTACT = "contact"


@struct.dataclass
class Block:
    """Rows of one type.

    Attributes:
      kind: cost of the rows, with their reference accelerations and regularisation.
      jacobian: how the rows depend on the accelerations.
      type: what the rows hold in place, static.
      ids: id of the element behind each entry along the first axis, static; empty for contacts.
      weight: mean inverse inertia of each entry, of rows with friction; else None.
    """

    kind: Kind
    jacobian: Jacobian
    type: RowType = struct.field(pytree_node=False)
    ids: tuple[int, ...] = struct.field(pytree_node=False, default=())
    weight: Float[Array, "n"] | None = None
