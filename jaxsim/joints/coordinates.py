"""Integration and difference on the configuration manifold: `qpos` and velocities times a time."""

from jaxtyping import Array, Float

from jaxsim.joints.grouping import per_joint, position_rows, velocity_rows
from jaxsim.model import Model


def integrate_pos(
    model: Model, qpos: Float[Array, "nq"], qvel: Float[Array, "nv"], dt: Float[Array, ""] | float
) -> Float[Array, "nq"]:
    """Coordinates after `dt` seconds at constant velocity, as `mj_integratePos`."""
    return per_joint(
        model.jnt_type,
        ("integrate",),
        lambda joint: lambda q, v: joint.integrate(q, v, dt),
        position_rows(model, qpos),
        velocity_rows(model, qvel),
        empty=qpos,
        start=model.jnt_qposadr,
    )


def difference_pos(
    model: Model,
    qpos1: Float[Array, "nq"],
    qpos2: Float[Array, "nq"],
    dt: Float[Array, ""] | float = 1.0,
) -> Float[Array, "nv"]:
    """Velocity that leads from `qpos1` to `qpos2` in `dt` seconds, as `mj_differentiatePos`."""
    moved = per_joint(
        model.jnt_type,
        ("difference",),
        lambda joint: joint.difference,
        position_rows(model, qpos1),
        position_rows(model, qpos2),
        empty=qpos1,
        start=model.jnt_dofadr,
    )
    return moved / dt


def exponential_rate(
    model: Model, qvel: Float[Array, "nv"], theta: Float[Array, "nv"]
) -> Float[Array, "nv"]:
    """Rate of the exponential coordinates theta of a configuration with velocity `qvel`.

    Args:
      model: the model.
      qvel: velocity at the configuration `integrate_pos(model, qpos, theta, 1)`, for any `qpos`.
      theta: the exponential coordinates with respect to `qpos`.

    Returns:
      `d(theta)/dt`; it does not depend on `qpos`.
    """
    return per_joint(
        model.jnt_type,
        ("exponential_rate",),
        lambda joint: joint.exponential_rate,
        velocity_rows(model, qvel),
        velocity_rows(model, theta),
        empty=qvel,
        start=model.jnt_dofadr,
    )
