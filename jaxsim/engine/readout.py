"""Sensor readings of an `Instant`."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.constraint import Constrained, RowType
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.tendons.tendon import tendon_velocity
from jaxsim.engine.instant import Instant
from jaxsim.forces.external import external_wrench
from jaxsim.model import State
from jaxsim.quantities.energy import kinetic_energy, potential_energy
from jaxsim.sensor import Signals, sensordata


def read_sensors(
    now: Instant, state: State, energy: Float[Array, "2"]
) -> Float[Array, "nsensordata"]:
    """Readings of all sensors of the model, without delays."""
    motion, acting, found = now.motion, now.actuation, now.constrained
    model = motion.model
    signals = Signals(
        motion=motion,
        time=state.time,
        energy=energy,
        tendon_length=motion.kin.ten_length,
        tendon_velocity=tendon_velocity(model, motion.kin, state.qvel),
        actuator_length=acting.actuator_length,
        actuator_velocity=acting.actuator_velocity,
        actuator_force=acting.actuator_force,
        qfrc_actuator=acting.qfrc_actuator,
        qacc=found.qacc,
        body_wrench=body_wrenches(motion, state, found),
        contact=found.contact,
        contact_force=found.contact_force,
        joint_limit_force=_limit_force(found, RowType.LIMIT_JOINT, model.njnt),
        tendon_limit_force=_limit_force(found, RowType.LIMIT_TENDON, model.ntendon),
    )
    return sensordata(signals)


def energies(now: Instant, state: State) -> Float[Array, "2"]:
    """Potential and kinetic energy."""
    motion = now.motion
    return jnp.stack(
        [
            potential_energy(motion.model, motion.kin, state.qpos),
            kinetic_energy(motion.model, motion.kin, motion.vel, state.qvel),
        ]
    )


def body_wrenches(motion: Motion, state: State, found: Constrained) -> Float[Array, "nbody 6"]:
    """External (torque, force) on each body about its centre of mass, with those of equalities."""
    model = motion.model
    eq_force = jnp.zeros((model.neq, 6), state.qpos.dtype)
    for block, force in zip(found.blocks, found.forces, strict=True):
        if block.type in (RowType.CONNECT, RowType.WELD):
            rows = jnp.pad(force, ((0, 0), (0, 6 - force.shape[1])))
            eq_force = eq_force.at[np.array(block.ids, int)].set(rows)
    return external_wrench(
        model, motion.kin, state.xfrc_applied, found.contact, found.contact_force, eq_force
    )


def _limit_force(found: Constrained, type_: RowType, n: int) -> Float[Array, "n"]:
    """Forces of limits at the ids of their joints or tendons; of two active ends, the lower's."""
    total = jnp.zeros(n, found.qacc.dtype)
    for block, force in reversed(list(zip(found.blocks, found.forces, strict=True))):
        if block.type is type_ and block.violation is not None:
            ids, active = np.array(block.ids, int), block.violation < 0
            total = total.at[ids].set(jnp.where(active, force, total[ids]))
    return total
