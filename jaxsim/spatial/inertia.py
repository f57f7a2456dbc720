"""Spatial inertia of a rigid body: mass, first moment and rotational inertia in one frame.

The rotational inertia is about the *origin of the frame*, not about the centre of mass, and
the first moment is mass times centre of mass, not the centre of mass. All three are then
linear in the distribution of mass, so bodies welded together simply add.
"""

import jax.numpy as jnp
import numpy as np
from flax import struct
from jaxtyping import Array, Float

from jaxsim.spatial.pose import Pose
from jaxsim.spatial.quaternion import quat_rotate, quat_to_matrix
from jaxsim.spatial.so3 import skew


@struct.dataclass
class Inertia:
    """Spatial inertia ``G`` in the axes of a frame and about its origin.

    Attributes:
        mass: kg.
        first_moment: mass times the position of the centre of mass (kg m).
        rotational: rotational inertia about the origin, ``sum m (|r|^2 1 - r r^T)`` (kg m^2).
    """

    mass: Float[Array, ""]
    first_moment: Float[Array, "3"]
    rotational: Float[Array, "3 3"]

    @classmethod
    def from_com(
        cls,
        mass: Float[Array, ""],
        com: Float[Array, "3"],
        inertia_at_com: Float[Array, "3 3"],
    ) -> "Inertia":
        """Inertia from quantities at the centre of mass, by the parallel axis theorem.

        Args:
            mass: kg.
            com: centre of mass from the frame's origin, in its axes (m).
            inertia_at_com: rotational inertia about the centre of mass, in the frame's axes.

        Raises:
            ValueError: a shape is wrong.
        """
        shapes = tuple(map(np.shape, (mass, com, inertia_at_com)))
        if shapes != ((), (3,), (3, 3)):
            raise ValueError(f"mass, com, inertia have shapes (), (3,), (3, 3), not {shapes}")
        com, inertia_at_com = jnp.asarray(com), jnp.asarray(inertia_at_com)
        mass = jnp.asarray(mass, dtype=jnp.result_type(mass, com, inertia_at_com))
        rotational = inertia_at_com + mass * _point_inertia(com, com)
        return cls(mass=mass, first_moment=mass * com, rotational=rotational)

    @classmethod
    def from_principal(
        cls,
        mass: Float[Array, ""],
        pose: Pose,
        moments: Float[Array, "3"],
    ) -> "Inertia":
        """Inertia from principal moments, and the pose of the principal frame at the com."""
        R = quat_to_matrix(pose.quat)
        return cls.from_com(mass, pose.pos, (R * moments[None]) @ R.T)

    @property
    def com(self) -> Float[Array, "3"]:
        """Centre of mass from the frame's origin (m); the origin itself without mass."""
        has_mass = self.mass > 0
        return jnp.where(has_mass, self.first_moment / jnp.where(has_mass, self.mass, 1.0), 0.0)

    @property
    def rotational_at_com(self) -> Float[Array, "3 3"]:
        """Rotational inertia about the centre of mass, in the frame's axes (kg m^2)."""
        return self.rotational - _point_inertia(self.com, self.first_moment)

    def apply(self, V: Float[Array, "6"]) -> Float[Array, "6"]:
        """Momentum ``G V = (I w + h x v, m v - h x w)``: angular about the origin, and linear."""
        w, v, h = V[:3], V[3:], self.first_moment
        angular = self.rotational @ w + jnp.cross(h, v)
        return jnp.concatenate([angular, self.mass * v - jnp.cross(h, w)])

    def solve(self, F: Float[Array, "6"]) -> Float[Array, "6"]:
        """Inverse of :meth:`apply`, ``G^-1 F``, for an inertia that is positive definite."""
        com = self.com
        w = _solve_symmetric(self.rotational_at_com, F[:3] - jnp.cross(com, F[3:]))
        return jnp.concatenate([w, F[3:] / self.mass + jnp.cross(com, w)])

    def kinetic_energy(self, V: Float[Array, "6"]) -> Float[Array, ""]:
        """``V . G V / 2`` in joules."""
        return 0.5 * V @ self.apply(V)

    def as_matrix(self) -> Float[Array, "6 6"]:
        """``[[I, h x], [-h x, m 1]]``, symmetric; it acts on twists, angular first."""
        h = skew(self.first_moment)
        top = jnp.concatenate([self.rotational, h], axis=1)
        linear = self.mass * jnp.eye(3, dtype=h.dtype)
        return jnp.concatenate([top, jnp.concatenate([-h, linear], axis=1)])

    def __add__(self, other: "Inertia") -> "Inertia":
        """Inertia of two bodies that are rigidly connected, both in the same frame."""
        return Inertia(
            mass=self.mass + other.mass,
            first_moment=self.first_moment + other.first_moment,
            rotational=self.rotational + other.rotational,
        )

    def rotate(self, quat: Float[Array, "4"]) -> "Inertia":
        """The inertia about the same origin, from the axes of B to those of A by ``q_AB``."""
        R = quat_to_matrix(quat)
        return self.replace(
            first_moment=quat_rotate(quat, self.first_moment),
            rotational=R @ self.rotational @ R.T,
        )

    def shift(self, p: Float[Array, "3"]) -> "Inertia":
        """The inertia about another origin, in the same axes.

        Args:
            p: position of the present origin from the new one (m); the centre of mass becomes
                ``com + p``.
        """
        h = self.first_moment
        cross_terms = _point_inertia(p, h) + _point_inertia(h, p)
        rotational = self.rotational + cross_terms + self.mass * _point_inertia(p, p)
        return self.replace(first_moment=h + self.mass * p, rotational=rotational)

    def transform(self, X: Pose) -> "Inertia":
        """The inertia in another frame, from B to A by ``X_AB``: ``Ad^-T G Ad^-1``."""
        return self.rotate(X.quat).shift(X.pos)

    def violations(self, tolerance: float = 1e-6) -> tuple[str, ...]:
        """Reasons why no real body has this inertia; empty if it is physically consistent.

        A consistent inertia has a positive mass, and its rotational inertia about the centre of
        mass is symmetric and positive semidefinite with principal moments that satisfy the triangle
        inequality. Runs on the host, not inside jit.

        Args:
            tolerance: allowed violation relative to the largest moment.
        """
        if not self.mass > 0:
            return (f"the mass is {float(self.mass):g} kg, it must be positive",)
        matrix = np.asarray(self.rotational_at_com, dtype=np.float64)
        if not np.isfinite(matrix).all():
            return ("the rotational inertia or the centre of mass is not finite",)
        # The shift to the centre of mass keeps the rounding error of the larger moment at the
        # origin.
        rounding = 4 * float(jnp.finfo(self.rotational.dtype).eps)
        slack = tolerance * np.abs(matrix).max() + rounding * np.abs(self.rotational).max()
        if np.abs(matrix - matrix.T).max() > slack:
            return ("the rotational inertia is not symmetric",)
        moments = np.linalg.eigvalsh(matrix)
        found = []
        if moments[0] < -slack:
            found.append(f"the smallest principal moment is negative, {moments[0]:g} kg m^2")
        if moments[0] + moments[1] < moments[2] - slack:
            shown = ", ".join(f"{moment:g}" for moment in moments)
            found.append(f"the principal moments {shown} break the triangle inequality")
        return tuple(found)


def _point_inertia(a, b):
    """``-skew(a) @ skew(b) = (a . b) 1 - b a^T``; for ``a = b`` a unit mass at ``a``."""
    return (a @ b) * jnp.eye(3, dtype=a.dtype) - jnp.outer(b, a)


def _solve_symmetric(A, b):
    """Solve a symmetric 3x3 system by Cramer's rule, which stays cheap under vmap."""
    x, y, z = A
    yz = jnp.cross(y, z)
    return jnp.stack([b @ yz, x @ jnp.cross(b, z), x @ jnp.cross(y, b)]) / (x @ yz)
