"""A joint type: the questions that the rest of the package asks about a joint."""

import dataclasses
import itertools
from collections.abc import Callable

from jaxtyping import Array, Float

from jaxsim.spatial import Pose

Vector3 = Float[Array, "3"]
Coordinates = Float[Array, "nq"]
Velocity = Float[Array, "nv"]
Scalar = Float[Array, ""]


@dataclasses.dataclass(frozen=True)
class Joint:
    """What one type of joint answers; every function is for one joint.

    A joint has coordinates q (nq numbers of `qpos`) and a velocity v (nv numbers of `qvel`). Its
    `axis` is a unit vector and its `anchor` the point that a rotation leaves in place (m), both in
    the link's frame. Types that answer a question by the same function are computed in one group.

    Attributes:
      name: for messages.
      number: MuJoCo's, `mujoco.mjtJoint`.
      nq: number of coordinates.
      nv: number of degrees of freedom.
      in_world: whether the pose is the link's in the world, whatever body the model hangs it on.
      turns: (nv,) which motion axes turn with the link; the others keep their direction in the
        world.
      parts: sizes of the parts of v that are vectors of their own, such as a translation and a
        rotation. Springs feel the length of each part of a displacement, and inverse weights are
        averaged over it.
      turns_about_axis: whether the link turns about `axis` and about nothing else.
      slides_along_axis: whether the link moves along `axis` and in no other direction.
      is_angle: whether whole turns leave an actuator's length as it is, which is then an angle.

      pose: `(q, q0, axis, anchor)` to the pose of the link in its joint frame; a single coordinate
        counts from `q0`, the one of the model's reference configuration.
      motion_axes: `(mat, pos, axis, anchor)` to (nv, 6) twists per unit velocity, in world axes
        about a reference point; `mat` is the link's orientation in the world, and `pos` its origin
        as seen from the reference point (m).
      integrate: `(q, v, dt)` to the coordinates after `dt` seconds at constant velocity.
      difference: `(q1, q2)` to the velocity that leads from q1 to q2 in one second.
      exponential_rate: `(v, theta)` to the rate of exponential coordinates theta (nv,) that the
        velocity means, at the coordinates `integrate(q, theta, 1)` for any q.
      transmission: `(q, gear, in_parent)` to the length of an actuator on the joint, zero where it
        has none, and the moment (nv,), its force on the degrees of freedom; `gear` (6,) are the
        actuator's, and `in_parent` (static) whether they are in the parent's axes.
      limit: `(q, bounds)` to the distances of what is limited from its lower and its upper end,
        infinite where there is no such end, and its derivative by v (nv,), for `bounds` (2,) of the
        model.
      clamp: `(q, bounds)` to the nearest coordinates within the limits.
    """

    name: str
    number: int
    nq: int
    nv: int
    turns: tuple[bool, ...]
    parts: tuple[int, ...]
    pose: Callable[[Coordinates, Coordinates, Vector3, Vector3], Pose]
    motion_axes: Callable[[Float[Array, "3 3"], Vector3, Vector3, Vector3], Float[Array, "nv 6"]]
    integrate: Callable[[Coordinates, Velocity, Scalar | float], Coordinates]
    difference: Callable[[Coordinates, Coordinates], Velocity]
    exponential_rate: Callable[[Velocity, Velocity], Velocity]
    transmission: Callable[[Coordinates, Float[Array, "6"], bool], tuple[Scalar, Velocity]]
    limit: Callable[[Coordinates, Float[Array, "2"]], tuple[Scalar, Scalar, Velocity]]
    clamp: Callable[[Coordinates, Float[Array, "2"]], Coordinates] = lambda q, bounds: q
    in_world: bool = False
    turns_about_axis: bool = False
    slides_along_axis: bool = False
    is_angle: bool = False

    def deflections(self, q: Coordinates, q0: Coordinates) -> list[Float[Array, "part"]]:
        """The parts of the displacement from q0, each of which has a spring."""
        moved, ends = self.difference(q0, q), itertools.accumulate(self.parts)
        return [moved[end - size : end] for size, end in zip(self.parts, ends, strict=True)]
