"""Tables of actuators: controls and activations of those that have several, and delays."""

import mujoco
import numpy as np

_PID = int(mujoco.mjtGain.mjGAIN_PID)
_DCMOTOR = int(mujoco.mjtGain.mjGAIN_DCMOTOR)
_PID_STATES = int(mujoco.mjtDyn.mjDYN_PID)
_INPUTS = tuple(
    int(getattr(mujoco.mjtCtrlInput, f"mjINPUT_{name}")) for name in ("POS", "VEL", "FF", "VOLTAGE")
)


def actuator_tables(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Fields of the model's structure that describe PID servos and DC motors.

    Which states such an actuator has depends on its numbers when it is compiled.

    Args:
      mj: a compiled model.

    Returns:
      `actuator_inputadr` (nactuator, 4): address in `ctrl` of the setpoints of position and
      velocity, the feedforward and the voltage. `actuator_stateadr` (nactuator, 5): address in
      `act` of the setpoint whose rate is limited, the integral, the temperature, the bristle and
      the current. -1 for what an actuator does not have, or if it is of another kind.
    """
    motor = (mj.actuator_gaintype == _DCMOTOR)[:, None]
    servo = (mj.actuator_gaintype == _PID)[:, None]
    inputs = (mj.actuator_ctrlspec[:, None] & np.array(_INPUTS)) > 0
    gain, dyn = mj.actuator_gainprm, mj.actuator_dynprm
    none = np.zeros(mj.nactuator)
    of_motor = np.stack([dyn[:, 7], gain[:, 5], dyn[:, 2], dyn[:, 5], dyn[:, 0]], axis=1) > 0
    of_servo = np.stack([dyn[:, 1], gain[:, 0], none, none, none], axis=1) > 0
    of_servo &= (mj.actuator_dyntype == _PID_STATES)[:, None]
    states = (motor & of_motor) | (servo & of_servo)
    return {
        "actuator_inputadr": _addresses(inputs & (motor | servo), mj.actuator_ctrladr),
        "actuator_stateadr": _addresses(states, mj.actuator_actadr),
    }


def delay_tables(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Fields of the model's structure that say which delays it has.

    Args:
      mj: a compiled model.

    Returns:
      `actuator_delayed` (nactuator,), `sensor_delayed` (nsensor,): whether it has a delay;
      `sensor_periodic` (nsensor,): whether it has an interval.
    """
    return {
        "actuator_delayed": mj.actuator_delay > 0,
        "sensor_delayed": mj.sensor_delay > 0,
        "sensor_periodic": mj.sensor_interval[:, 0] > 0,
    }


def _addresses(present: np.ndarray, first: np.ndarray) -> np.ndarray:
    """Consecutive addresses of what is present in each row, -1 elsewhere."""
    place = np.cumsum(present, axis=1) - 1
    return np.where(present, first[:, None] + place, -1).astype(np.int64)
