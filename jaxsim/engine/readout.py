"""What sensors need to know, gathered from an evaluated instant."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.collision import Contact
from jaxsim.constraint import Constrained, RowType
from jaxsim.dynamics.kinematics import Kinematics
from jaxsim.dynamics.tendon import tendon_length, tendon_velocity
from jaxsim.engine.pipeline import Evaluation
from jaxsim.forces.external import external_wrench
from jaxsim.model import Model, State
from jaxsim.sensor import Signals, sensordata


def read_sensors(
    model: Model, state: State, now: Evaluation, energy: Float[Array, "2"]
) -> Float[Array, "nsensordata"]:
    """Readings of all sensors of the model."""
    s, found = now.smooth, now.constrained
    signals = Signals(
        qpos=state.qpos,
        qvel=state.qvel,
        kin=s.kin,
        vel=s.vel,
        time=state.time,
        energy=energy,
        tendon_length=tendon_length(model, state.qpos),
        tendon_velocity=tendon_velocity(model, state.qvel),
        actuator_length=s.actuation.actuator_length,
        actuator_velocity=s.actuation.actuator_velocity,
        actuator_force=s.actuation.actuator_force,
        qfrc_actuator=s.actuation.qfrc_actuator,
        qacc=found.qacc,
        body_wrench=body_wrenches(model, state, s.kin, now.contact, found),
        contact=now.contact,
        contact_force=found.contact_force,
        joint_limit_force=_by_id(now, RowType.LIMIT_JOINT, model.njnt),
        tendon_limit_force=_by_id(now, RowType.LIMIT_TENDON, model.ntendon),
    )
    return sensordata(model, signals)


def body_wrenches(
    model: Model, state: State, kin: Kinematics, contact: Contact, found: Constrained
) -> Float[Array, "nbody 6"]:
    """External (torque, force) on each body about its centre of mass, equalities included."""
    eq_force = jnp.zeros((model.neq, 6), state.qpos.dtype)
    for block, force in zip(found.blocks, found.forces, strict=True):
        if block.type in (RowType.CONNECT, RowType.WELD):
            rows = jnp.pad(force, ((0, 0), (0, 6 - force.shape[1])))
            eq_force = eq_force.at[np.array(block.ids, int)].set(rows)
    return external_wrench(model, kin, state.xfrc_applied, contact, found.contact_force, eq_force)


def _by_id(now: Evaluation, type_: RowType, n: int) -> Float[Array, "n"]:
    """Row forces of one type, placed at the elements to which they belong."""
    total = jnp.zeros(n, now.smooth.qfrc_smooth.dtype)
    for block, force in zip(now.constrained.blocks, now.constrained.forces, strict=True):
        if block.type is type_:
            total = total.at[np.array(block.ids, int)].add(force)
    return total
