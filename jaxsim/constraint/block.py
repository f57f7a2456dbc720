"""`Block`: constraint rows of one type, with their cost and their Jacobian."""

import enum

from flax import struct
from jaxtyping import Array, Float

from jaxsim.constraint.entry import Entry
from jaxsim.constraint.jacobian import Jacobian
from jaxsim.constraint.rigid.impact import Approach
from jaxsim.solver import Kind


class RowType(enum.Enum):
    """The types of rows; their values are names for messages."""

    CONNECT = "connect equality"
    WELD = "weld equality"
    JOINT = "joint equality"
    TENDON = "tendon equality"
    FRICTION_DOF = "joint friction"
    FRICTION_TENDON = "tendon friction"
    LIMIT_JOINT = "joint limit"
    LIMIT_TENDON = "tendon limit"
    CONTACT = "contact"
    HOLD = "joint of free bodies"
    REFLECTED = "armature between free bodies"


@struct.dataclass
class Block:
    """Rows of one type.

    Attributes:
      kind: cost of the rows, with their reference accelerations and regularisation.
      jacobian: Jacobian of the rows.
      type: type of the rows, static.
      ids: id of the constrained element for each index of the first axis, static; empty for
        contacts.
      violation: violation of each row, relative to its margin; None for friction, which has none,
        and for contacts, whose record has it.
      weight: mean inverse inertia for each index of the first axis; None for rows without friction.
      entry: what rows do when they become active; None if derivatives do not need it.
      approach: normal motion of rigid contacts; None for others.
      rigid: whether the rows have no regularisation in the end, static; rigid contacts have none
        anyway.
    """

    kind: Kind
    jacobian: Jacobian
    type: RowType = struct.field(pytree_node=False)
    ids: tuple[int, ...] = struct.field(pytree_node=False, default=())
    violation: Array | None = None
    weight: Float[Array, "n"] | None = None
    entry: Entry | None = None
    approach: Approach | None = None
    rigid: bool = struct.field(pytree_node=False, default=False)
