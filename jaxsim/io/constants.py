"""Constants that MuJoCo derives from masses, sizes and poses at the reference configuration."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.precision import full_precision
from jaxsim.dynamics.aba import solve_mass
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.dynamics.jacobian import body_jacobians
from jaxsim.dynamics.kinematics import Kinematics, kinematics
from jaxsim.dynamics.tendon import tendon_jacobian, tendon_length
from jaxsim.dynamics.transmission import actuator_moment, transmission
from jaxsim.dynamics.tree import accumulate_inward
from jaxsim.joints.types import BALL, FREE
from jaxsim.model import Model
from jaxsim.spatial import Pose

_CONNECT = int(mujoco.mjtEq.mjEQ_CONNECT)
_BODY = int(mujoco.mjtObj.mjOBJ_BODY)


@full_precision
def set_const(model: Model) -> Model:
    """Recompute the derived constants after masses, sizes or poses have changed.

    These are `body_subtreemass`, `body_invweight0`, `dof_invweight0`, `dof_M0`,
    `tendon_length0`, `tendon_invweight0`, `actuator_length0`, `actuator_acc0`, the second anchor
    of `connect` constraints, and the statistics `meaninertia` and `meanmass`: MuJoCo's
    `mj_setConst`. Differentiable, and under `vmap` one model at a time.

    Args:
      model: a model whose leaves may have been changed.

    Returns:
      The model with consistent constants.
    """
    mocap = [list(model.body_mocapid).index(m) for m in range(model.nmocap)]
    kin = kinematics(model, model.qpos0, model.body_pos[mocap,], model.body_quat[mocap,])
    mass = composite_mass_matrix(model, kin)
    inverse = jax.vmap(lambda force: solve_mass(model, kin, force))
    model = model.replace(
        body_subtreemass=_subtree_masses(model),
        body_invweight0=_body_weights(model, kin, inverse),
        dof_invweight0=_dof_weights(
            model, jnp.diagonal(inverse(jnp.eye(model.nv, dtype=mass.dtype)))
        ),
        dof_M0=jnp.diagonal(mass),
        eq_data=_connect_anchors(model, kin),
        stat=_statistics(model, mass),
    )
    return _path_constants(model, kin, inverse)


def _subtree_masses(model: Model) -> Float[Array, "nbody"]:
    forest = model.structure.body_tree
    total = accumulate_inward(forest, take(model.body_mass, forest.order))
    return take(total, forest.position)


def _body_weights(model: Model, kin: Kinematics, inverse) -> Float[Array, "nbody 2"]:
    """Mean translational and rotational inverse inertia at the centre of mass."""
    J = body_jacobians(model, kin, kin.xipos)
    weights = jax.vmap(lambda rows: jnp.sum(rows * inverse(rows), axis=1))(J)
    return jnp.stack([weights[:, 3:].mean(1), weights[:, :3].mean(1)], axis=1)


def _dof_weights(model: Model, diagonal: Float[Array, "nv"]) -> Float[Array, "nv"]:
    """Diagonal of the inverse mass matrix, averaged over each triple of a ball or free joint."""
    groups = np.arange(model.nv)
    for j in range(model.njnt):
        start = model.jnt_dofadr[j]
        triples = {FREE: 2, BALL: 1}.get(int(model.jnt_type[j]), 0)
        for t in range(triples):
            groups[start + 3 * t : start + 3 * t + 3] = start + 3 * t
    average = (groups[:, None] == groups[None, :]).astype(float)
    average /= average.sum(1, keepdims=True)
    return jnp.asarray(average, diagonal.dtype) @ diagonal


def _connect_anchors(model: Model, kin: Kinematics) -> Float[Array, "neq 12"]:
    """The anchor of a connect constraint in its second body, where the first body's anchor is."""
    data = model.eq_data
    for i in np.nonzero((model.eq_type == _CONNECT) & (model.eq_objtype == _BODY))[0]:
        first, second = (
            Pose(kin.xquat[b], kin.xpos[b]) for b in (model.eq_obj1id[i], model.eq_obj2id[i])
        )
        anchor = second.inverse().apply(first.apply(data[i, :3]))
        data = data.at[i, 3:6].set(anchor)
    return data


def _statistics(model: Model, mass: Float[Array, "nv nv"]):
    if model.nv == 0:
        return model.stat
    return model.stat.replace(
        meaninertia=jnp.diagonal(mass).mean(), meanmass=model.body_mass[1:].mean()
    )


def _path_constants(model: Model, kin: Kinematics, inverse) -> Model:
    """Lengths and inverse inertias along tendons and actuators."""
    J = tendon_jacobian(model)
    paths = transmission(model, kin, model.qpos0)
    moment = actuator_moment(model, paths)
    return model.replace(
        tendon_length0=tendon_length(model, model.qpos0),
        tendon_invweight0=jnp.sum(J * inverse(J), axis=1),
        actuator_length0=paths.length,
        actuator_acc0=jnp.sqrt(_positive(jnp.sum(inverse(moment) ** 2, axis=1))),
    )


def _positive(x):
    # An actuator that moves nothing must not make the derivative infinite.
    return jnp.where(x > 0, x, jnp.finfo(x.dtype).tiny)
