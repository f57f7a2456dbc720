"""Joint types, one file each: `JOINTS` has them by MuJoCo's number, `joint.py` defines a type."""

from jaxsim.joints.ball import BALL
from jaxsim.joints.free import FREE
from jaxsim.joints.hinge import HINGE
from jaxsim.joints.joint import Joint
from jaxsim.joints.slide import SLIDE

JOINTS: dict[int, Joint] = {joint.number: joint for joint in (FREE, BALL, SLIDE, HINGE)}

__all__ = ["FREE", "JOINTS", "Joint"]
