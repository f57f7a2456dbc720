"""What the later stages of MuJoCo computed, as arrays of fixed shapes that can be fed to ours."""

import mujoco
import numpy as np
from flax import struct
from jaxtyping import Array

MAX_CONTACTS = 24
FIELDS = (
    "qpos qvel qacc energy actuator_length actuator_velocity actuator_force qfrc_actuator "
    "ten_length ten_velocity xfrc_applied mocap_pos mocap_quat"
).split()


@struct.dataclass
class Contacts:
    """The part of a contact record that wrenches and sensors read."""

    dist: Array
    includemargin: Array
    pos: Array
    frame: Array
    geom1: Array
    geom2: Array

    @property
    def active(self) -> Array:
        """Whether each contact has force."""
        return self.dist < self.includemargin


def rollout(mj, count: int = 6, every: int = 15) -> list[mujoco.MjData]:
    """Data at several instants of a rollout with random controls and external forces."""
    rng = np.random.default_rng(5)
    data, found = mujoco.MjData(mj), []
    data.qvel[:] = rng.normal(size=mj.nv)
    for _ in range(count):
        data.ctrl[:] = rng.normal(size=mj.nu)
        data.xfrc_applied[:] = rng.normal(size=(mj.nbody, 6))
        for _ in range(every):
            mujoco.mj_step(mj, data)
        found.append(evaluated(mj, data))
    return found


def evaluated(mj, data) -> mujoco.MjData:
    """A copy of the data with everything computed."""
    other = mujoco.MjData(mj)
    mujoco.mj_copyData(other, mj, data)
    mujoco.mj_forward(mj, other)
    mujoco.mj_energyPos(mj, other)
    mujoco.mj_energyVel(mj, other)
    mujoco.mj_subtreeVel(mj, other)
    mujoco.mj_rnePostConstraint(mj, other)
    return other


def record(mj, d) -> dict:
    """State, forces, contacts padded to `MAX_CONTACTS`, and multipliers of the constraints."""
    values = {name: np.array(getattr(d, name)) for name in FIELDS}
    values["time"] = np.array(d.time)
    values["eq_force"], values["joint_limit_force"], values["tendon_limit_force"] = _rows(mj, d)
    assert d.ncon <= MAX_CONTACTS
    force = np.zeros((MAX_CONTACTS, 6))
    for i in range(d.ncon):
        mujoco.mj_contactForce(mj, d, i, force[i])
    geom, frame = _padded(d.contact.geom), _padded(d.contact.frame).reshape(-1, 3, 3)
    dist = _padded(d.contact.dist) + 1e6 * (np.arange(MAX_CONTACTS) >= d.ncon)
    margin = _padded(d.contact.includemargin)
    pos = _padded(d.contact.pos)
    values["contact"] = Contacts(dist, margin, pos, frame, geom[:, 0], geom[:, 1])
    return values | {"contact_force": force}


def _padded(x):
    return np.concatenate([x, np.zeros((MAX_CONTACTS - len(x), *x.shape[1:]), x.dtype)])


def _rows(mj, d):
    """Multipliers of connects and welds (neq, 6), of joint limits and of tendon limits."""
    kind = mujoco.mjtConstraint
    equality, filled = np.zeros((mj.neq, 6)), np.zeros(mj.neq, int)
    limit = {kind.mjCNSTR_LIMIT_JOINT: np.zeros(mj.njnt)}
    limit[kind.mjCNSTR_LIMIT_TENDON] = np.zeros(mj.ntendon)
    for row in range(d.nefc):
        k, i = kind(int(d.efc_type[row])), d.efc_id[row]
        if k == kind.mjCNSTR_EQUALITY and mj.eq_type[i] <= int(mujoco.mjtEq.mjEQ_WELD):
            equality[i, filled[i]] = d.efc_force[row]
            filled[i] += 1
        if k in limit and limit[k][i] == 0:  # the lower end comes first
            limit[k][i] = d.efc_force[row]
    return equality, *limit.values()
