"""Joint coordinates of free bodies, and what their poses lack to be those of the joints.

The error of a body is that of its pose in its parent's frame, compared with the pose that the
joints have at the coordinates q,

    e(x, q) = (R_A^T (p_B - p_A) - p(q),  2 vec(conj(r(q)) conj(r_A) r_B)),

six numbers. Coordinates belong to the smallest error. With the Jacobians X of the bodies' motion
and S of the joints', and with e's second derivative b along the motion at constant velocities,

    P e = 0,  P X v = 0,  P (X a + b) = 0,    P = 1 - S S^+

hold while the joints do, and then `q' = -S^+ X v` and `q'' = -S^+ (X a + b)`. P projects onto what
the joints do not move; its six rows have a rank of six minus their degrees of freedom.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from flax import struct
from jax import lax
from jaxtyping import Array, Float

from jaxsim.arrays.indexing import gather_or_zero, take
from jaxsim.batching.matrices import cholesky, cholesky_solve
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.joints.coordinates import integrate_pos
from jaxsim.model import Model, State
from jaxsim.spatial import Pose, quat_conj, quat_exp, quat_inv_rotate, quat_mul

# Steps of Gauss-Newton, which converges quadratically. The guess is that of constant velocity.
_STEPS = 3


@struct.dataclass
class JointMotion:
    """Coordinates and rows of the joints of m moving bodies, in a state of the free bodies.

    Attributes:
      qpos: coordinates q.
      qvel: velocities q'.
      error: P e.
      error_rate: P X v.
      rows: P X, over the degrees of freedom of the free bodies.
      bias: P b.
      rates: -S^+ X.
      rates_bias: -S^+ b.
    """

    qpos: Float[Array, "nq"]
    qvel: Float[Array, "n"]
    error: Float[Array, "m 6"]
    error_rate: Float[Array, "m 6"]
    rows: Float[Array, "m 6 nv"]
    bias: Float[Array, "m 6"]
    rates: Float[Array, "n nv"]
    rates_bias: Float[Array, "n"]


class Links(NamedTuple):
    """Which bodies joints connect; all static.

    Attributes:
      body: (m,) the moving bodies.
      parent: (m,) their parents.
      parent_index: (m,) index of the parent among the moving bodies, -1 if it does not move.
      dofs: (m, k) degrees of freedom of the joints of each body, -1 for none.
    """

    body: np.ndarray
    parent: np.ndarray
    parent_index: np.ndarray
    dofs: np.ndarray

    @classmethod
    def of(cls, tree: Model) -> "Links":
        """Those of a model."""
        body = np.flatnonzero(tree.body_weldid != 0)
        parent = tree.body_parentid[body]
        index = np.full(tree.nbody, -1)
        index[body] = np.arange(len(body))
        count = tree.body_dofnum[body]
        k = np.arange(max(1, count.max(initial=0)))[None]
        dofs = np.where(k < count[:, None], tree.body_dofadr[body][:, None] + k, -1)
        return cls(body, parent, index[parent], dofs)

    @property
    def held(self) -> np.ndarray:
        """Indices of the bodies whose joints leave them less than six degrees of freedom."""
        return np.flatnonzero((self.dofs >= 0).sum(axis=1) < 6)


def body_poses(tree: Model, qpos: Float[Array, "nq"], state: State) -> Pose:
    """(nbody,) poses of all bodies at joint coordinates."""
    kin = kinematics(tree, qpos, state.mocap_pos, state.mocap_quat)
    return Pose(quat=kin.xquat, pos=kin.xpos)


def joint_coordinates(
    tree: Model, bodies: Pose, qpos: Float[Array, "nq"], state: State
) -> Float[Array, "nq"]:
    """The coordinates with the smallest errors of the bodies, from a guess `qpos`."""
    links = Links.of(tree)

    def nearer(_, qpos):
        error, S = _error(links, tree, bodies, qpos, state), _axes(links, tree, bodies, qpos, state)
        step = _on_dofs(links, tree.nv, -_least_squares(links, S, error))
        return integrate_pos(tree, qpos, step, 1.0)

    return lax.fori_loop(0, _STEPS, nearer, qpos)


def joint_motion(
    tree: Model,
    bodies: Pose,
    velocity: Float[Array, "m 6"],
    qpos: Float[Array, "nq"],
    state: State,
) -> JointMotion:
    """Coordinates, velocities and rows of the joints.

    Args:
      tree: the model whose joints these are.
      bodies: (nbody,) poses of all bodies.
      velocity: of the moving bodies: world axes for the origin, the body's for rotation.
      qpos: guess of the coordinates.
      state: with the poses of mocap bodies.
    """
    links = Links.of(tree)
    qpos = joint_coordinates(tree, bodies, qpos, state)
    error, S = _error(links, tree, bodies, qpos, state), _axes(links, tree, bodies, qpos, state)
    X = _body_rows(links, tree, bodies, qpos, state)
    apart = lambda r: _least_squares(links, S, r)  # noqa: E731
    without = lambda r: r - jnp.einsum("mik,mk...->mi...", S, apart(r))  # noqa: E731
    rates = -_on_dofs(links, tree.nv, apart(X))
    qvel = rates @ velocity.reshape(-1)
    bias = _second_rate(links, tree, bodies, velocity, qpos, qvel, state)
    return JointMotion(
        qpos=qpos,
        qvel=qvel,
        error=without(error),
        error_rate=without(X @ velocity.reshape(-1)),
        rows=without(X),
        bias=without(bias),
        rates=rates,
        rates_bias=-_on_dofs(links, tree.nv, apart(bias)),
    )


def _error(links: Links, tree: Model, bodies: Pose, qpos, state: State) -> Float[Array, "m 6"]:
    parent, child = take_poses(bodies, links.parent), take_poses(bodies, links.body)
    return _difference(parent, child, _relative_of(links, tree, qpos, state))


def _relative_of(links: Links, tree: Model, qpos, state: State) -> Pose:
    """Poses of the bodies in their parents' frames, at joint coordinates."""
    poses = body_poses(tree, qpos, state)
    return _relative(take_poses(poses, links.parent), take_poses(poses, links.body))


def _relative(parent: Pose, child: Pose) -> Pose:
    return Pose(
        quat=jax.vmap(lambda a, b: quat_mul(quat_conj(a), b))(parent.quat, child.quat),
        pos=jax.vmap(quat_inv_rotate)(parent.quat, child.pos - parent.pos),
    )


def _difference(parent: Pose, child: Pose, wanted: Pose) -> Float[Array, "m 6"]:
    """The errors e."""
    found = _relative(parent, child)
    turn = jax.vmap(lambda a, b: quat_mul(quat_conj(a), b))(wanted.quat, found.quat)
    nearer = jnp.where(turn[:, :1] < 0, -2.0, 2.0)  # q and -q are the same rotation
    return jnp.concatenate([found.pos - wanted.pos, nearer * turn[:, 1:]], axis=1)


def _axes(links: Links, tree: Model, bodies: Pose, qpos, state: State) -> Float[Array, "m 6 k"]:
    """S. A body's error depends on its own joints only, so one tangent serves all bodies."""
    units = np.zeros((links.dofs.shape[1], tree.nv))
    for k, dofs in enumerate(links.dofs.T):
        units[k, dofs[dofs >= 0]] = 1.0

    def along(unit):
        moved = lambda t: integrate_pos(tree, qpos, unit, t)  # noqa: E731
        return _rate(lambda t: _error(links, tree, bodies, moved(t), state), qpos.dtype)

    S = jax.vmap(along, out_axes=-1)(jnp.asarray(units, qpos.dtype))
    return jnp.where((links.dofs >= 0)[:, None], S, 0.0)


def _body_rows(links: Links, tree: Model, bodies: Pose, qpos, state: State):
    """X (m, 6, nv): blocks of each body and of its parent."""
    parent, child = take_poses(bodies, links.parent), take_poses(bodies, links.body)
    wanted = _relative_of(links, tree, qpos, state)
    m = len(links.body)

    def columns(moved):
        unit = lambda v: jnp.broadcast_to(v, (m, 6))  # noqa: E731
        along = lambda v: _rate(lambda t: moved(unit(v), t), qpos.dtype)  # noqa: E731
        return jax.vmap(along, out_axes=-1)(jnp.eye(6, dtype=qpos.dtype))

    own = columns(lambda v, t: _difference(parent, moved_poses(child, v, t), wanted))
    other = columns(lambda v, t: _difference(moved_poses(parent, v, t), child, wanted))
    X = jnp.zeros((m, 6, m, 6), qpos.dtype).at[np.arange(m), :, np.arange(m)].set(own)
    (hung,) = np.nonzero(links.parent_index >= 0)
    X = X.at[hung, :, links.parent_index[hung]].set(other[hung])
    return X.reshape(m, 6, 6 * m)


def _second_rate(links: Links, tree: Model, bodies: Pose, velocity, qpos, qvel, state: State):
    """b, the second derivative of the errors at constant velocities."""
    parent, child = take_poses(bodies, links.parent), take_poses(bodies, links.body)
    above = gather_or_zero(velocity, jnp.asarray(links.parent_index))

    def error(t):
        wanted = _relative_of(links, tree, integrate_pos(tree, qpos, qvel, t), state)
        return _difference(moved_poses(parent, above, t), moved_poses(child, velocity, t), wanted)

    return _rate(lambda t: _rate(lambda u: error(t + u), qpos.dtype), qpos.dtype)


def _rate(f: Callable[[Array], Array], dtype) -> Array:
    """The derivative of a function of time at zero."""
    zero, one = jnp.zeros((), dtype), jnp.ones((), dtype)
    return jax.jvp(f, (zero,), (one,))[1]


def moved_poses(poses: Pose, velocity: Float[Array, "m 6"], t) -> Pose:
    """Poses after a time t at constant velocities of free joints."""
    turned = jax.vmap(lambda q, w: quat_mul(q, quat_exp(t * w)))(poses.quat, velocity[:, 3:])
    return Pose(quat=turned, pos=poses.pos + t * velocity[:, :3])


def take_poses(poses: Pose, index: np.ndarray) -> Pose:
    """Some of the poses."""
    return jax.tree.map(lambda x: take(x, index), poses)


def _least_squares(links: Links, S: Float[Array, "m 6 k"], r: Float[Array, "m 6 ..."]):
    """`S^+ r` of each body (m, k, ...); zero for degrees of freedom that do not exist."""
    missing = jnp.asarray(links.dofs < 0, S.dtype)
    gram = jnp.einsum("mik,mil->mkl", S, S) + jax.vmap(jnp.diag)(missing)
    right = jnp.einsum("mik,mi...->mk...", S, r)
    return jax.vmap(lambda A, b: cholesky_solve(cholesky(A), b))(gram, right)


def _on_dofs(links: Links, nv: int, x: Float[Array, "m k ..."]) -> Float[Array, "nv ..."]:
    """Values of the joints' degrees of freedom in MuJoCo's order."""
    at = np.zeros((nv, 2), int)
    at[links.dofs[links.dofs >= 0]] = np.argwhere(links.dofs >= 0)
    return x[at[:, 0], at[:, 1]]
