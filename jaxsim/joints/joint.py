"""`Joint`: the sizes and functions that define a joint type."""

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
    """One joint type; every function is for one joint.

    A joint has coordinates q (nq numbers of `qpos`) and a velocity v (nv numbers of `qvel`). Its
    `axis` is a unit vector and its `anchor` the fixed point of rotations (m), both in the link's
    frame. Types that share a function are computed together.

    Attributes:
      name: name in messages.
      number: MuJoCo's number, of `mujoco.mjtJoint`.
      nq: number of coordinates.
      nv: number of degrees of freedom.
      in_world: whether `pose` is the link's pose in the world, whatever its parent body.
      turns: (nv,) whether each motion axis turns with the link; the others keep their direction in
        the world.
      parts: sizes of the vectors that make up v, such as a translation and a rotation. A spring
        acts on the length of each of these vectors, and inverse weights are averaged over each.
      turns_about_axis: whether the link rotates about `axis` and has no other motion.
      slides_along_axis: whether the link translates along `axis` and has no other motion.
      is_angle: whether the length of an actuator is an angle modulo whole turns.

      pose: from `(q, q0, axis, anchor)`, the pose of the link in its joint frame. A scalar joint
        moves by `q - q0`, with q0 of the model's reference configuration.
      motion_axes: from `(mat, pos, axis, anchor)`, the (nv, 6) twists for unit velocities, in world
        axes about a reference point. `mat` is the link's orientation in the world, and `pos` the
        position of its origin from the reference point (m).
      integrate: from `(q, v, dt)`, the coordinates after `dt` seconds at constant velocity.
      difference: from `(q1, q2)`, the velocity that leads from q1 to q2 in one second.
      exponential_rate: from `(v, theta)`, the rate of the exponential coordinates theta (nv,) for
        velocity v at the coordinates `integrate(q, theta, 1)`; it does not depend on q.
      transmission: from `(q, gear, in_parent)`, the length of an actuator on the joint (zero where
        a length is not defined), and its moment (nv,), the generalised force for a unit force.
        `gear` (6,) is in the parent's axes if `in_parent` (static), else in the link's.
      limit: from `(q, bounds)`, the distances of the limited quantity to its lower and its upper
        limit, infinite where there is no limit, and the derivative (nv,) of that quantity with
        respect to v. `bounds` (2,) is the model's range.
      clamp: from `(q, bounds)`, the nearest coordinates within the limits.
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
        """The displacement from q0, split into its `parts`; a spring acts on each."""
        moved, ends = self.difference(q0, q), itertools.accumulate(self.parts)
        return [moved[end - size : end] for size, end in zip(self.parts, ends, strict=True)]
