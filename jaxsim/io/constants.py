"""`set_const`: constants derived from masses, sizes and poses at the reference configuration."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.arrays.precision import full_precision
from jaxsim.arrays.whole import as_a_whole
from jaxsim.dynamics.aba import solve_mass
from jaxsim.dynamics.crba import tree_mass_matrix
from jaxsim.dynamics.jacobian import body_jacobians
from jaxsim.dynamics.kinematics import Kinematics, kinematics
from jaxsim.dynamics.tendons.tendon import tendon_jacobian
from jaxsim.dynamics.transmission import actuator_moment, transmission
from jaxsim.dynamics.tree import accumulate_inward
from jaxsim.joints import JOINTS
from jaxsim.model import Model
from jaxsim.model.inputs import admit_model
from jaxsim.quantities.cameras import mounted_frames
from jaxsim.spatial import Pose

_CONNECT = int(mujoco.mjtEq.mjEQ_CONNECT)
_WELD = int(mujoco.mjtEq.mjEQ_WELD)
_BODY = int(mujoco.mjtObj.mjOBJ_BODY)
_SLIDES_ONLY = 2  # value of `body_simple`: only slides along the body's axes, diagonal inertia


@full_precision
def set_const(model: Model) -> Model:
    """Recompute the derived constants after masses, sizes or poses have changed, as `mj_setConst`.

    They are `body_subtreemass`, `body_invweight0`, `dof_invweight0`, `dof_M0`, `tendon_length0`,
    `tendon_invweight0`, `actuator_length0`, `actuator_acc0`, `cam_pos0`, `cam_poscom0`, `cam_mat0`,
    and in `eq_data` the anchors and poses of `connect` and `weld` constraints at the reference
    configuration. The function is differentiable and takes one model; use `jax.vmap` for a batch.

    Args:
      model: a model whose leaves may have been changed.

    Returns:
      The model with consistent constants.

    Raises:
      TypeError: the model is not a `Model`, or the numbers in an array are of the wrong type.
      ValueError: an array has the wrong shape.
    """
    model = admit_model(model)
    return _with_constants(model)


@as_a_whole
def _with_constants(model: Model) -> Model:
    kin = kinematics(model, model.qpos0)
    mass = tree_mass_matrix(model, kin)
    inverse = jax.vmap(lambda force: solve_mass(model, kin, force))
    model = model.replace(
        body_subtreemass=_subtree_masses(model),
        body_invweight0=_body_weights(model, kin, inverse),
        dof_invweight0=_dof_weights(
            model, jnp.diagonal(inverse(jnp.eye(model.nv, dtype=mass.dtype)))
        ),
        # As in MuJoCo, without tendons' armature.
        dof_M0=jnp.diagonal(mass),
        eq_data=_equality_poses(model, kin),
    )
    return _path_constants(model.replace(**_camera_offsets(model, kin)), kin, inverse)


def _subtree_masses(model: Model) -> Float[Array, "nbody"]:
    forest = model.structure.body_tree
    total = accumulate_inward(forest, take(model.body_mass, forest.order))
    return take(total, forest.position)


def _body_weights(model: Model, kin: Kinematics, inverse) -> Float[Array, "nbody 2"]:
    """Mean translational and rotational inverse inertia at the centre of mass.

    As in MuJoCo, a body that only slides along its own axes has its inverse mass, whatever the
    number of these axes.
    """
    J = body_jacobians(model, kin, kin.xipos)
    weights = jax.vmap(lambda rows: jnp.sum(rows * inverse(rows), axis=1))(J)
    mean = jnp.stack([weights[:, 3:].mean(1), weights[:, :3].mean(1)], axis=1)
    (sliding,) = np.nonzero(model.body_simple == _SLIDES_ONLY)
    inverse_mass = 1 / model.body_mass[sliding,]
    return mean.at[sliding,].set(jnp.stack([inverse_mass, 0 * inverse_mass], axis=1))


def _dof_weights(model: Model, diagonal: Float[Array, "nv"]) -> Float[Array, "nv"]:
    """Diagonal of the inverse mass matrix, averaged over each of a joint's `parts`.

    As in MuJoCo, slides that move only one body have its inverse mass, whatever their armature.
    """
    sizes = [size for kind in model.jnt_type for size in JOINTS[int(kind)].parts]
    groups = np.repeat(np.arange(len(sizes)), np.array(sizes, int))
    average = (groups[:, None] == groups[None, :]).astype(float)
    average /= average.sum(1, keepdims=True)
    body = model.jnt_bodyid[model.dof_jntid]
    alone = model.body_simple[body] == _SLIDES_ONLY
    mass = jnp.where(alone, take(model.body_mass, body), 1.0)
    return jnp.where(alone, 1 / mass, jnp.asarray(average, diagonal.dtype) @ diagonal)


def _equality_poses(model: Model, kin: Kinematics) -> Float[Array, "neq 12"]:
    """`eq_data` with the anchors and poses of connects and welds at the reference configuration.

    A connect stores the anchor on its first body; the anchor on the second body is computed. A weld
    stores the anchor on its second body; where the file gives no relative pose, the anchor on the
    first body and the relative orientation are computed.
    """
    data = model.eq_data
    for i in np.nonzero(model.eq_objtype == _BODY)[0]:
        first, second = (
            Pose(kin.xquat[b], kin.xpos[b]) for b in (model.eq_obj1id[i], model.eq_obj2id[i])
        )
        if model.eq_type[i] == _CONNECT:
            anchor = second.inverse().apply(first.apply(data[i, :3]))
            data = data.at[i, 3:6].set(anchor)
        elif model.eq_type[i] == _WELD:
            relative = first.inverse() @ second
            found = jnp.concatenate([relative.apply(data[i, :3]), relative.quat])
            # MuJoCo's compiler sets entry 11 to one where it has computed the pose.
            data = data.at[i, 3:10].set(jnp.where(data[i, 11] == 1, found, data[i, 3:10]))
    return data


def _camera_offsets(model: Model, kin: Kinematics) -> dict[str, Array]:
    """Poses of the cameras relative to what they follow, by field name."""
    pos, mat = mounted_frames(model, kin)
    body, target = model.cam_bodyid, model.cam_targetbodyid
    return {
        "cam_pos0": pos - take(kin.xpos, body),
        "cam_poscom0": pos - take(kin.subtree_com, np.where(target >= 0, target, body)),
        "cam_mat0": mat.reshape(-1, 9),
    }


def _path_constants(model: Model, kin: Kinematics, inverse) -> Model:
    """The model with lengths and inverse inertias of tendons and actuators."""
    J = tendon_jacobian(model, kin)
    paths = transmission(model, kin, model.qpos0)
    moment = actuator_moment(model, paths)
    return model.replace(
        tendon_length0=kin.ten_length,
        tendon_invweight0=jnp.sum(J * inverse(J), axis=1),
        actuator_length0=paths.length,
        actuator_acc0=jnp.sqrt(_positive(jnp.sum(inverse(moment) ** 2, axis=1))),
    )


def _positive(x):
    # The square root has no finite derivative at zero, the value of an actuator that moves nothing.
    return jnp.where(x > 0, x, jnp.finfo(x.dtype).tiny)
