"""Fixed tendons: lengths that are linear combinations of joint positions.

Results have an entry for every tendon of the model, which is zero for spatial tendons.
"""

import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import sum_by, take
from jaxsim.model import Model

_JOINT = int(mujoco.mjtWrap.mjWRAP_JOINT)


def fixed_length(model: Model, qpos: Float[Array, "nq"]) -> Float[Array, "ntendon"]:
    """Lengths `sum_j coef_j q_j`, in the units of the joints."""
    wraps, tendons = _wraps(model)
    positions = take(qpos, model.jnt_qposadr[model.wrap_objid[wraps]])
    return sum_by(take(model.wrap_prm, wraps) * positions, tendons, model.ntendon)


def fixed_velocity(model: Model, qvel: Float[Array, "nv"]) -> Float[Array, "ntendon"]:
    """Rates of the lengths, `J qvel`."""
    wraps, tendons = _wraps(model)
    rates = take(qvel, model.jnt_dofadr[model.wrap_objid[wraps]])
    return sum_by(take(model.wrap_prm, wraps) * rates, tendons, model.ntendon)


def fixed_force_on_joints(model: Model, tension: Float[Array, "ntendon"]) -> Float[Array, "nv"]:
    """Generalised forces `J^T tension` of forces along the tendons, positive if they lengthen."""
    wraps, tendons = _wraps(model)
    each = take(model.wrap_prm, wraps) * take(tension, tendons)
    return sum_by(each, model.jnt_dofadr[model.wrap_objid[wraps]], model.nv)


def fixed_jacobian(model: Model) -> Float[Array, "ntendon nv"]:
    """J, the constant derivative of the lengths; rows are tendons."""
    wraps, tendons = _wraps(model)
    dofs = model.jnt_dofadr[model.wrap_objid[wraps]]
    zero = jnp.zeros((model.ntendon, model.nv), model.wrap_prm.dtype)
    return zero.at[tendons, dofs].add(take(model.wrap_prm, wraps))


def _wraps(model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Indices of the joints on all fixed tendons, and the tendon of each; static."""
    spans = [a + np.arange(n) for a, n in zip(model.tendon_adr, model.tendon_num, strict=True)]
    wraps = np.concatenate([np.zeros(0, int), *spans]).astype(int)
    tendons = np.repeat(np.arange(model.ntendon), model.tendon_num)
    fixed = model.wrap_type[wraps] == _JOINT
    return wraps[fixed], tendons[fixed]
