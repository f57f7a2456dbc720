"""Log-Cholesky coordinates of a body's inertia: ten numbers, each value of which is physical.

A distribution of mass has a positive definite pseudo-inertia, the second moments of (x, y, z, 1):

    [[S, m c], [m c^T, m]] = e^(2 a) U U^T,   U = [[e^d1, s12, s13, t1],
                                                   [   0, e^d2, s23, t2],
                                                   [   0,    0, e^d3, t3],
                                                   [   0,    0,    0,  1]]

with mass m, centre of mass c and second moments S about the body's origin (Rucker and Wensing
2022, "Smooth parameterization of rigid-body inertia"). So `m = e^(2 a)` and `c = t`; the rotational
inertia about c is `tr(Sc) 1 - Sc` with `Sc = S - m c c^T`. Lengths are in units of the body's
radius of gyration at first, so that all ten numbers are relative.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jaxsim.batching.matrices import eigh
from jaxsim.model import Model
from jaxsim.spatial import quat_from_matrix, quat_mul, quat_normalize, quat_to_matrix
from jaxsim.sysid.errors import SysidError

COMPONENTS = ("mass", "d1", "d2", "d3", "s12", "s23", "s13", "com x", "com y", "com z")
_THINNEST = 1e-4  # least part of a principal second moment in their sum


def to_log_cholesky(model: Model, body: int) -> tuple[Float[Array, "10"], float]:
    """The coordinates of a body, and its radius of gyration (m)."""
    mass, moments = float(model.body_mass[body]), np.asarray(model.body_inertia[body], float)
    if not mass > 0 or not moments.sum() > 0:
        name = model.names.label("body", body)
        raise SysidError(
            f"{name} has no mass or no inertia at first, so its logarithms do not exist"
        )
    second = np.maximum(moments.sum() / 2 - moments, _THINNEST * moments.sum())
    length = float(np.sqrt(second.sum() / mass))
    R = np.asarray(quat_to_matrix(quat_normalize(model.body_iquat[body])), float)
    com = np.asarray(model.body_ipos[body], float) / length
    central = (R * second) @ R.T / (mass * length**2)
    U = np.linalg.cholesky(central[::-1, ::-1])[::-1, ::-1]  # upper triangular, U U^T = central
    d, s = np.log(np.diagonal(U)), (U[0, 1], U[1, 2], U[0, 2])
    return jnp.asarray([np.log(mass) / 2, *d, *s, *com], model.body_mass.dtype), length


def from_log_cholesky(model: Model, body: int, x: Float[Array, "10"], length: float) -> Model:
    """The model with another inertia of one body."""
    mass, com = jnp.exp(2 * x[0]), length * x[7:]
    U = jnp.diag(jnp.exp(x[1:4])).at[(0, 1, 0), (1, 2, 2)].set(x[4:7])
    central = mass * length**2 * (U @ U.T)
    rotational = jnp.trace(central) * jnp.eye(3, dtype=x.dtype) - central
    moments, quat = principal_axes(rotational)
    return model.replace(
        body_mass=model.body_mass.at[body].set(mass),
        body_ipos=model.body_ipos.at[body].set(com),
        body_inertia=model.body_inertia.at[body].set(moments),
        body_iquat=model.body_iquat.at[body].set(quat),
    )


@jax.custom_jvp
def principal_axes(
    inertia: Float[Array, "3 3"],
) -> tuple[Float[Array, "3"], Float[Array, "4"]]:
    """Principal moments of a symmetric matrix, and the quaternion of their axes.

    Axes of equal moments are not differentiable, but what is put together again from moments and
    axes is. The moments are therefore set apart by a relative `eps^1/2`, which is far below what
    data determine, and the derivative is exact for these.
    """
    return _principal(inertia)[:2]


def _principal(inertia):
    moments, R = eigh(inertia)
    R = R * jnp.where(jnp.linalg.det(R) < 0, -1.0, 1.0)
    apart = float(jnp.finfo(inertia.dtype).eps) ** 0.5 * moments[2]
    return moments + apart * jnp.arange(3.0, dtype=R.dtype), quat_from_matrix(R), R


@principal_axes.defjvp
def _principal_axes_jvp(primals, tangents):
    """`R^T dI R` has the rates of the moments on its diagonal; the rest turns the axes."""
    moments, quat, R = _principal(primals[0])
    rate = R.T @ tangents[0] @ R
    # dR = R [w]x gives off-diagonal rates (m_j - m_i) [w]x_ij.
    pairs = ((2, 1), (0, 2), (1, 0))
    w = jnp.stack([rate[i, j] / (moments[j] - moments[i]) for i, j in pairs])
    turning = 0.5 * quat_mul(quat, jnp.concatenate([jnp.zeros(1, w.dtype), w]))
    return (moments, quat), (jnp.diagonal(rate), turning)
