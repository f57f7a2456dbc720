"""Check that the mass matrix of a model is invertible."""

import copy

import mujoco
import numpy as np

from jaxsim.model.errors import ModelError
from jaxsim.model.names import Label

# A pivot smaller than this, relative to its diagonal entry, is rounding error.
_MIN_PIVOT = 1e-13


def check_mass_matrix(mj: mujoco.MjModel, label: Label) -> None:
    """Raise `ModelError` if the mass matrix is singular in the reference configuration.

    Redundant joints of a body, such as four slides, have no unique accelerations.
    """
    if mj.nv == 0:
        return
    matrix = _mass_matrix(mj)
    scale = matrix.diagonal().copy()
    # Leaves first: a pivot is the inertia at a joint while all joints further out move freely.
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
    """`sum_b m J_b^T J_b + W_b^T I_b W_b` over all bodies, plus what MuJoCo adds to the diagonal.

    Armature of tendons is included.

    For bodies with `body_simple`, MuJoCo's own matrix leaves out entries that it takes for zero;
    they are not zero for two slides along one axis.
    """
    data = mujoco.MjData(mj)
    mujoco.mj_kinematics(mj, data)
    mujoco.mj_comPos(mj, data)
    mujoco.mj_tendon(mj, data)
    matrix, moving, turning = (np.zeros((n, mj.nv)) for n in (mj.nv, 3, 3))
    diagonal = _compiled(mj, data).diagonal().copy()
    if mj.ntendon:
        bare = copy.copy(mj)
        bare.tendon_armature[:] = 0
        bare.actuator_armature[:] = 0
        matrix += _compiled(mj, data) - _compiled(bare, data)
    for b in np.nonzero(mj.body_mass)[0]:
        mujoco.mj_jacBodyCom(mj, data, moving, turning, b)
        # The joints that move this body, of which there are few.
        (dofs,) = np.nonzero(moving.any(axis=0) | turning.any(axis=0))
        moved, turned = moving[:, dofs], data.ximat[b].reshape(3, 3).T @ turning[:, dofs]
        inertia = mj.body_mass[b] * moved.T @ moved + turned.T * mj.body_inertia[b] @ turned
        matrix[np.ix_(dofs, dofs)] += inertia
    np.fill_diagonal(matrix, diagonal)
    return matrix


def _compiled(mj: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """MuJoCo's own mass matrix."""
    matrix = np.zeros((mj.nv, mj.nv))
    mujoco.mj_makeM(mj, data)
    mujoco.mj_fullM(mj, data, matrix)
    return matrix
