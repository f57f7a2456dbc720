"""Equality constraints: connect, weld, joint and tendon."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from jaxsim.arrays.indexing import take
from jaxsim.arrays.norms import safe_norm
from jaxsim.constraint.block import Block, RowType
from jaxsim.constraint.impedance import inverse_where, response
from jaxsim.constraint.jacobian import DenseRows, link_rows, moves_anything, row_velocity
from jaxsim.constraint.points import Ends, bias_acceleration, ends, twist_rows
from jaxsim.constraint.row_inertia import row_inertia
from jaxsim.dynamics.motion import Motion
from jaxsim.dynamics.tendons.tendon import tendon_jacobian
from jaxsim.model.dof_order import to_tree_order
from jaxsim.solver import Quadratic
from jaxsim.spatial import quat_conj, quat_mul

_EQ = mujoco.mjtEq
_EQUALITY_OFF = mujoco.mjtDisableBit.mjDSBL_EQUALITY


def equality_blocks(motion: Motion) -> list[Block]:
    """The blocks of the model's active equality constraints, in MuJoCo's order of types."""
    model = motion.model
    if model.opt.disabled(_EQUALITY_OFF):
        return []
    makers = {
        int(_EQ.mjEQ_CONNECT): _connect,
        int(_EQ.mjEQ_WELD): _weld,
        int(_EQ.mjEQ_JOINT): _joint,
        int(_EQ.mjEQ_TENDON): _tendon,
    }
    blocks = []
    for kind, make in makers.items():
        (ids,) = np.nonzero((model.eq_type == kind) & model.eq_active0.astype(bool))
        if len(ids):
            blocks.append(make(motion, ids))
    return blocks


def _connect(motion: Motion, ids: np.ndarray) -> Block:
    """Rows by which two points coincide, three each."""
    data = take(motion.model.eq_data, ids)
    e = ends(motion, ids, data[:, :3], data[:, 3:6])
    G1, G2 = (twist_rows(motion, e, side, rotation=False) for side in (0, 1))
    jacobian = link_rows(e.link[1], G2, e.link[0], G1)
    bias = bias_acceleration(motion, e)[:, :3]
    return _block(
        motion, ids, jacobian, e.pos[0] - e.pos[1], bias, _weights(motion, e, 1), RowType.CONNECT
    )


def _weld(motion: Motion, ids: np.ndarray) -> Block:
    """Rows by which two frames coincide: three for the position, three for the orientation.

    The rotational error is the vector part of `conj(q2) q1 q_rel`. Its rate is half of the vector
    part of `conj(q2) (0, w1 - w2) q1 q_rel`, a 3x3 matrix times the relative angular velocity.
    """
    model = motion.model
    data = take(model.eq_data, ids)
    e = ends(motion, ids, data[:, 3:6], data[:, :3])
    scale = data[:, 10]
    first, second = _weld_quaternions(motion, ids, data[:, 6:10])
    error = jax.vmap(lambda a, b: quat_mul(quat_conj(b), a)[1:])(first, second)
    mix = jax.vmap(_rotation_rate)(first, second) * scale[:, None, None]
    rows = []
    for side in (0, 1):
        G = twist_rows(motion, e, side, rotation=True)
        rows.append(jnp.concatenate([G[:, :3], jax.vmap(jnp.matmul)(mix, G[:, 3:])], axis=1))
    jacobian = link_rows(e.link[1], rows[1], e.link[0], rows[0])
    violation = jnp.concatenate([e.pos[0] - e.pos[1], scale[:, None] * error], axis=1)
    bias = bias_acceleration(motion, e)
    turn = jax.vmap(_rotation_bias)(first, second, e.omega[0], e.omega[1])
    spin = jax.vmap(jnp.matmul)(mix, bias[:, 3:]) + scale[:, None] * turn
    bias = jnp.concatenate([bias[:, :3], spin], axis=1)
    return _block(motion, ids, jacobian, violation, bias, _weights(motion, e, 2), RowType.WELD)


def _weld_quaternions(motion: Motion, ids: np.ndarray, relative):
    """Orientations of both ends of welds, the first one composed with the relative pose."""
    model = motion.model
    first, second, sites = [], [], model.eq_objtype[ids] == int(mujoco.mjtObj.mjOBJ_SITE)
    for k, i in enumerate(ids):
        one, two = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
        if sites[k]:
            quats = [
                quat_mul(motion.kin.xquat[model.site_bodyid[s]], model.site_quat[s])
                for s in (one, two)
            ]
        else:
            quats = [quat_mul(motion.kin.xquat[one], relative[k]), motion.kin.xquat[two]]
        first.append(quats[0])
        second.append(quats[1])
    return jnp.stack(first), jnp.stack(second)


def _rotation_rate(first, second):
    """3x3 matrix from a relative angular velocity to the rate of the rotational error."""

    def rate(w):
        axis = jnp.concatenate([jnp.zeros_like(w[:1]), w])
        return 0.5 * quat_mul(quat_mul(quat_conj(second), axis), first)[1:]

    return jax.vmap(rate, out_axes=1)(jnp.eye(3, dtype=first.dtype))


def _rotation_bias(first, second, w1, w2):
    """Part of the rotational error's second derivative that depends on angular velocities only."""

    def pure(w):
        return jnp.concatenate([jnp.zeros_like(w[:1]), w])

    first_rate, second_rate = 0.5 * quat_mul(pure(w1), first), 0.5 * quat_mul(pure(w2), second)
    relative = pure(w1 - w2)
    one = quat_mul(quat_mul(quat_conj(second_rate), relative), first)
    two = quat_mul(quat_mul(quat_conj(second), relative), first_rate)
    return 0.5 * (one + two)[1:]


def _weights(motion: Motion, e: Ends, columns: int):
    """Inverse inertia of each row: translational, and then rotational if `columns` is 2."""
    weight = take(motion.model.body_invweight0, e.body[0]) + take(
        motion.model.body_invweight0, e.body[1]
    )
    return jnp.repeat(weight[:, :columns], 3, axis=1)


def _block(motion: Motion, ids, jacobian, violation, bias, weight, type_: RowType) -> Block:
    """A block; the rows of one constraint share an impedance, a function of the error's norm."""
    model = motion.model
    velocity = row_velocity(motion, jacobian)
    weight = row_inertia(motion, jacobian, weight)

    def one(solref, solimp, violation, velocity, weight):
        r = response(model.opt, solref, solimp, safe_norm(violation))
        return r.reference(velocity, violation), r.regularisation(weight)

    inputs = take(model.eq_solref, ids), take(model.eq_solimp, ids), violation, velocity, weight
    aref, R = jax.vmap(one)(*inputs)
    return Block(Quadratic(aref - bias, 1 / R), jacobian, type_, tuple(ids.tolist()), violation)


def _joint(motion: Motion, ids: np.ndarray) -> Block:
    """Rows by which a scalar joint is a polynomial of another, or constant."""
    model = motion.model
    dofs = [model.jnt_dofadr[i] for i in (model.eq_obj1id[ids], model.eq_obj2id[ids])]
    addresses = [model.jnt_qposadr[i] for i in (model.eq_obj1id[ids], model.eq_obj2id[ids])]
    displacement = [take(motion.qpos, a) - take(model.qpos0, a) for a in addresses]
    unit = jnp.asarray(np.eye(model.nv), motion.qvel.dtype)
    return _polynomial(
        motion,
        ids,
        displacement,
        [take(unit, d) for d in dofs],
        [take(model.dof_invweight0, d) for d in dofs],
        RowType.JOINT,
    )


def _tendon(motion: Motion, ids: np.ndarray) -> Block:
    """Rows by which a tendon's length is a polynomial of another's, or constant."""
    model = motion.model
    both = model.eq_obj1id[ids], np.maximum(model.eq_obj2id[ids], 0)
    stretch = motion.kin.ten_length - model.tendon_length0
    rows = tendon_jacobian(model, motion.kin)
    return _polynomial(
        motion,
        ids,
        [take(stretch, t) for t in both],
        [take(rows, t) for t in both],
        [take(model.tendon_invweight0, t) for t in both],
        RowType.TENDON,
    )


def _polynomial(motion: Motion, ids, value, J, weight, type_: RowType) -> Block:
    """Rows `value1 = poly(value2)` of degree four; without a second object, poly is constant."""
    model = motion.model
    paired = jnp.asarray(model.eq_obj2id[ids] >= 0, motion.qvel.dtype)
    coefficients = take(model.eq_data, ids)[:, :5]

    def one(c, x):
        powers = jnp.stack([jnp.ones_like(x), x, x * x, x**3, x**4])
        slopes = jnp.stack([jnp.ones_like(x), 2 * x, 3 * x * x, 4 * x**3])
        return c @ powers, c[1:] @ slopes

    target, slope = jax.vmap(one)(coefficients, value[1] * paired)
    rows = J[0] - (slope * paired)[:, None] * J[1]
    violation = value[0] - target
    jacobian = DenseRows(to_tree_order(model, rows.T).T)
    velocity = row_velocity(motion, jacobian)

    def row(solref, solimp, violation, velocity, weight):
        r = response(model.opt, solref, solimp, violation)
        return r.reference(velocity, violation), r.regularisation(weight)

    weights = row_inertia(motion, jacobian, weight[0] + paired * weight[1])
    inputs = take(model.eq_solref, ids), take(model.eq_solimp, ids), violation, velocity, weights
    aref, R = jax.vmap(row)(*inputs)
    D = inverse_where(moves_anything(rows), R)
    return Block(Quadratic(aref, D), jacobian, type_, tuple(ids.tolist()), violation)
