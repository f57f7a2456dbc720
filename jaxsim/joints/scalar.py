"""What hinge and slide joints share: one coordinate whose rate is the velocity."""

from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from jaxsim.joints.joint import Joint


def scalar_joint(
    name: str,
    number: int,
    pose: Callable,
    motion_axes: Callable,
    turns_about_axis: bool = False,
    slides_along_axis: bool = False,
) -> Joint:
    """A joint type with one coordinate; arguments as in `Joint`."""
    return Joint(
        name=name,
        number=number,
        nq=1,
        nv=1,
        turns=(True,),
        parts=(1,),
        pose=pose,
        motion_axes=motion_axes,
        integrate=_integrate,
        difference=_difference,
        exponential_rate=_exponential_rate,
        transmission=_transmission,
        limit=_limit,
        clamp=_clamp,
        turns_about_axis=turns_about_axis,
        slides_along_axis=slides_along_axis,
    )


def _integrate(
    q: Float[Array, "1"], v: Float[Array, "1"], dt: Float[Array, ""] | float
) -> Float[Array, "1"]:
    return q + v * dt


def _difference(q1: Float[Array, "1"], q2: Float[Array, "1"]) -> Float[Array, "1"]:
    return q2 - q1


def _exponential_rate(v: Float[Array, "1"], theta: Float[Array, "1"]) -> Float[Array, "1"]:
    return v


def _transmission(q: Float[Array, "1"], gear: Float[Array, "6"], in_parent: bool):
    """`in_parent` makes no difference: the axis is the same in the link and in its parent."""
    moment = gear[:1]
    return moment[0] * q[0], moment


def _limit(q: Float[Array, "1"], bounds: Float[Array, "2"]):
    x, (low, high) = q[0], bounds
    return x - low, high - x, jnp.ones_like(q)


def _clamp(q: Float[Array, "1"], bounds: Float[Array, "2"]) -> Float[Array, "1"]:
    return jnp.clip(q, bounds[0], bounds[1])
