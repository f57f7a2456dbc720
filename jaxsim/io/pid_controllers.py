"""PID controllers: actuators with MuJoCo's plugin `mujoco.pid`."""

from collections.abc import Iterator

import mujoco
import numpy as np

from jaxsim.io.plugins import number, plugins
from jaxsim.model.names import Label
from jaxsim.model.problems import ModelProblem

NAME = "mujoco.pid"
_NUMBERS = "kp ki kd imax slewmax".split()
_NONE = int(mujoco.mjtDyn.mjDYN_NONE)
_LAGS = tuple(
    int(getattr(mujoco.mjtDyn, f"mjDYN_{name}")) for name in ("INTEGRATOR", "FILTER", "FILTEREXACT")
)
_FIXED = int(mujoco.mjtGain.mjGAIN_FIXED)
_BIASES = int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE)


def pid_leaf(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    """The model's leaf `actuator_pid`: (nactuator, 5) gains and limits, zero for other actuators.

    They are the plugin's `kp`, `ki`, `kd`, the largest force of the integral `imax` and the largest
    rate of the setpoint `slewmax`. Whether there is an integral, and which limits there are, is
    static: see `pid_tables`.
    """
    leaf = np.zeros((mj.nactuator, len(_NUMBERS)))
    for actuator, given in _controllers(mj):
        leaf[actuator] = [number(given[name]) for name in _NUMBERS]
    return {"actuator_pid": leaf}


def pid_tables(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    """Fields of the model's structure that describe PID controllers.

    Returns:
      `pid_actuator` (n,): the actuators. `pid_stateadr` (n, 3): addresses in `act` of the integral
      of the error, the setpoint before, and the state of the actuator's own dynamics, -1 for what
      it does not have. `pid_windup` (n,): whether the force of the integral is limited.
    """
    actuators, places, windup = [], [], []
    for actuator, given in _controllers(mj):
        has = _states(mj, actuator, given)
        first = np.cumsum(has) - 1 + mj.actuator_actadr[actuator]
        actuators.append(actuator)
        places.append(np.where(has, first, -1))
        windup.append(bool(has[0] and given["imax"]))
    return {
        "pid_actuator": np.array(actuators, int),
        "pid_stateadr": np.array(places, int).reshape(-1, 3),
        "pid_windup": np.array(windup, bool),
    }


def unsupported_controllers(mj: mujoco.MjModel, label: Label) -> Iterator[ModelProblem]:
    """Actuators with other plugins, and controllers that MuJoCo misreads."""
    instances = plugins(mj)
    for actuator in map(int, np.flatnonzero(mj.actuator_plugin >= 0)):
        if instances[mj.actuator_plugin[actuator]].name == NAME:
            reasons = _reasons(mj, actuator)
        else:
            reasons = [f"the only plugin of actuators that is supported is {NAME!r}"]
        yield from (ModelProblem(label("actuator", actuator), reason) for reason in reasons)


def _reasons(mj: mujoco.MjModel, actuator: int) -> Iterator[str]:
    if mj.actuator_dyntype[actuator] not in (_NONE, *_LAGS):
        yield "a PID controller may have dyntype none, integrator, filter or filterexact"
    gain, bias = mj.actuator_gaintype[actuator], mj.actuator_biastype[actuator]
    if gain != _FIXED or bias not in _BIASES:
        yield "a PID controller takes no gain or bias from a default; give it a class of its own"
    # The plugin takes numbers of actuators for those of controls and forces.
    if not mj.nu == mj.nactuator == mj.nout:
        yield "beside a PID controller, each actuator must have one control and one force"
    if mj.actuator_delay[actuator] and mj.actuator_dyntype[actuator] == _NONE:
        yield "MuJoCo ignores the delay of a PID controller without dynamics; remove it"


def _controllers(mj: mujoco.MjModel) -> Iterator[tuple[int, dict[str, str]]]:
    """The PID controllers, and the attributes of their plugins."""
    instances = plugins(mj)
    for actuator in map(int, np.flatnonzero(mj.actuator_plugin >= 0)):
        yield actuator, instances[mj.actuator_plugin[actuator]].attributes


def _states(mj: mujoco.MjModel, actuator: int, given: dict[str, str]) -> np.ndarray:
    """(3,) whether it has an integral, a limited setpoint and dynamics of its own."""
    lags = mj.actuator_dyntype[actuator] in _LAGS
    return np.array([number(given["ki"]) != 0, given["slewmax"] != "", lags])
