"""Whether the mass matrix of a model can be inverted."""

import mujoco
import numpy as np

from jaxsim.model.errors import ModelError
from jaxsim.model.names import Label

# A pivot this small next to its diagonal entry is rounding.
_MIN_PIVOT = 1e-13


def check_mass_matrix(mj: mujoco.MjModel, label: Label) -> None:
    """Raise `ModelError` if the mass matrix is singular in the reference configuration.

    Joints of a body that can undo each other, such as four slides, have no unique accelerations.
    """
    if mj.nv == 0:
        return
    matrix = _mass_matrix(mj)
    scale = matrix.diagonal().copy()
    # Leaves first: a pivot is the inertia that a joint feels while all joints further out yield.
    for k in reversed(range(mj.nv)):
        pivot, column = matrix[k, k], matrix[:k, k]
        if not pivot > _MIN_PIVOT * scale[k]:
            raise ModelError(
                f"{label('joint', int(mj.dof_jntid[k]))}: the mass matrix is singular at qpos0; "
                "remove the joint if others can make the same motion, or give it armature"
            )
        (rows,) = np.nonzero(column)
        matrix[np.ix_(rows, rows)] -= np.outer(column[rows], column[rows]) / pivot


def _mass_matrix(mj: mujoco.MjModel) -> np.ndarray:
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    mujoco.mj_comPos(mj, data)
    mujoco.mj_makeM(mj, data)
    matrix = np.zeros((mj.nv, mj.nv))
    mujoco.mj_fullM(mj, data, matrix)
    return matrix
