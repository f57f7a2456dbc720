"""Derivatives of every public function, in both modes, against float64 central differences.

The samples contain the singular points: no rotation, half a turn, and angles a rounding away
from both. A logarithm jumps at half a turn, so there it is differentiated inside expressions that
do not, and against the formula that continues smoothly beyond it.
"""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax.flatten_util import ravel_pytree
from numpy.testing import assert_allclose

import jaxsim.spatial as sp
from jaxsim.spatial import Inertia, Pose

AXES = np.array([[1.0, 0.0, 0.0], [0.0, 0.6, -0.8], [0.48, 0.64, 0.6]])
NEAR = (0.0, 1e-9, 1e-3, 0.5, 2.0)
HALF_TURN = (np.pi - 1e-4, np.pi - 1e-9, np.pi)
MODES = {"forward": jax.jacfwd, "reverse": jax.jacrev}

# Each program runs once, on a few numbers: time spent on optimising it would be wasted.
jit = functools.partial(jax.jit, compiler_options={"xla_backend_optimization_level": 0})


def rotation_vectors(angles):
    return (np.asarray(angles)[:, None, None] * AXES[None]).reshape(-1, 3)


def ordinary(size, count):
    return np.random.default_rng(size).normal(size=(count, size))


def quaternions(w):
    angle = np.linalg.norm(w, axis=1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / 2 / np.pi) * w], axis=1)


def body(flat):
    """A body from ten numbers, positive definite for whatever values."""
    root = flat[4:].reshape(2, 3)
    inertia = 2 * jnp.eye(3, dtype=flat.dtype) + root.T @ root
    return Inertia.from_com(1 + flat[0] ** 2, flat[1:4], inertia)


def of_twist(V):
    """Functions that are smooth at every rotation, half a turn included."""
    return {
        "so3_exp": sp.so3_exp(V[:3]),
        "se3_exp": sp.se3_exp(V),
        "ad": sp.ad(V),
        "skew": sp.skew(V[:3]),
        "unskew": sp.unskew(jnp.outer(V[:3], V[3:])),
        "exp of so3_log": sp.so3_exp(sp.so3_log(sp.so3_exp(V[:3]))),
    }


def of_quaternions(x):
    """Functions of two unit quaternions, not half a turn apart, and a vector."""
    a, b, v = x[:4], x[4:8], x[8:]
    return {
        "quat_mul": sp.quat_mul(a, b),
        "quat_conj": sp.quat_conj(a),
        "quat_rotate": sp.quat_rotate(a, v),
        "quat_inv_rotate": sp.quat_inv_rotate(a, v),
        "quat_to_matrix": sp.quat_to_matrix(a),
        "quat_from_matrix": sp.quat_from_matrix(sp.quat_to_matrix(a)),
        "quat_normalize": sp.quat_normalize(a),
        "quat_log": sp.quat_log(a),
        "quat_exp": sp.quat_exp(v),
        "quat_difference": sp.quat_difference(a, b),
        "quat_integrate": sp.quat_integrate(a, v, 0.3),
        "quat_from_axis_angle": sp.quat_from_axis_angle(v, a[0]),
    }


def of_poses(x):
    """Functions of two poses, a twist and a wrench."""
    X, Y = Pose(quat=x[:4], pos=x[4:7]), Pose(quat=x[7:11], pos=x[11:14])
    V, F = x[14:20], x[20:26]
    return {
        "compose": X @ Y,
        "inverse": X.inverse(),
        "apply": X.apply(V[:3]),
        "matrix": X.as_matrix(),
        "from_matrix": Pose.from_matrix(X.as_matrix()),
        "se3_log": sp.se3_log(X),
        "adjoint": sp.adjoint(X),
        "coadjoint": sp.coadjoint(X),
        "spatial_twist": sp.spatial_twist(X, V),
        "body_twist": sp.body_twist(X, V),
        "spatial_wrench": sp.spatial_wrench(X, F),
        "body_wrench": sp.body_wrench(X, F),
        "cross_motion": sp.cross_motion(V, F),
        "cross_force": sp.cross_force(V, F),
        "power": sp.power(V, F),
    }


def of_body(x):
    """Functions of a body, a pose, a twist and a wrench."""
    G, X, V, F = body(x[:10]), Pose(quat=x[10:14], pos=x[14:17]), x[17:23], x[23:29]
    return {
        "apply": G.apply(V),
        "solve": G.solve(F),
        "as_matrix": G.as_matrix(),
        "kinetic_energy": G.kinetic_energy(V),
        "transform": G.transform(X) + G,
        "com": G.com,
        "rotational_at_com": G.rotational_at_com,
        "from_principal": Inertia.from_principal(V[0], X, F[:3]),
        "newton_euler_wrench": sp.newton_euler_wrench(G, V, F),
        "newton_euler_acceleration": sp.newton_euler_acceleration(G, V, F),
    }


CASES = {
    "twist": of_twist,
    "quaternions": of_quaternions,
    "poses": of_poses,
    "body": of_body,
}

# The results whose derivatives could depend on the precision: divisions and changes of branch.
DELICATE = {
    "twist": ("se3_exp", "exp of so3_log"),
    "quaternions": ("quat_normalize", "quat_difference", "quat_from_matrix"),
    "poses": ("se3_log",),
    "body": ("solve",),
}


def samples(kind):
    """Arguments of a case, as the rows of an array."""
    half, w = rotation_vectors(NEAR + HALF_TURN), rotation_vectors(NEAR)
    a, v = quaternions(w), ordinary(3, len(w))
    b = a[[2, 0, 1] * len(NEAR)]
    parts = {
        "twist": (half, ordinary(3, len(half))),
        "quaternions": (a * np.where(np.arange(len(a)) % 2, 1.0, -1.0)[:, None], b, v),
        "poses": (a, v, b, v[::-1], ordinary(12, len(a))),
        "body": (ordinary(10, len(a)), a, ordinary(15, len(a))),
    }
    return np.concatenate(parts[kind], axis=1)


def central_differences(function, x, step=1e-4):
    """Jacobians (n, out, in) of each result at the rows of ``x``, of fourth order."""
    reach = step * np.array([-2.0, -1.0, 1.0, 2.0])
    weight = np.array([1.0, -8.0, 8.0, -1.0]) / (12 * step)
    size = x.shape[1]
    points = x[:, None, None] + (reach[:, None, None] * np.eye(size)[None])[None]
    values = jit(jax.vmap(flattened(function)))(jnp.asarray(points.reshape(-1, size)))
    shape = (len(x), len(reach), size, -1)
    return {
        name: np.einsum("k,nkio->noi", weight, np.reshape(value, shape))
        for name, value in values.items()
    }


def flattened(function):
    """The same function with each of its named results as one vector."""
    return lambda x: {name: ravel_pytree(value)[0] for name, value in function(x).items()}


def jacobians(function, x):
    """Jacobians (n, out, in) of each result at the rows of ``x``, by both modes."""
    function = flattened(function)
    return jit(lambda x: {name: jax.vmap(mode(function))(x) for name, mode in MODES.items()})(x)


@functools.cache
def expected(kind):
    with jax.enable_x64(True):
        return central_differences(CASES[kind], samples(kind))


@pytest.mark.parametrize("kind", list(CASES))
def test_both_modes_against_central_differences(x64, kind):
    for mode, results in jacobians(CASES[kind], jnp.asarray(samples(kind))).items():
        for name, actual in results.items():
            assert_allclose(
                actual, expected(kind)[name], rtol=1e-9, atol=1e-9, err_msg=f"{name}, {mode}"
            )


@pytest.mark.parametrize("kind", list(DELICATE))
def test_both_modes_in_float32(kind):
    def delicate(x):
        results = CASES[kind](x)
        return {name: results[name] for name in DELICATE[kind]}

    for mode, results in jacobians(delicate, jnp.asarray(samples(kind), jnp.float32)).items():
        for name, actual in results.items():
            assert actual.dtype == jnp.float32
            assert_allclose(
                actual, expected(kind)[name], rtol=2e-4, atol=2e-4, err_msg=f"{name}, {mode}"
            )


def test_log_of_exp_is_the_identity_up_to_half_a_turn(x64):
    """At the half turn itself too, from whose near side the derivative is taken."""
    w = rotation_vectors(NEAR + HALF_TURN)
    V = jnp.asarray(np.concatenate([w, ordinary(3, len(w))], axis=1))
    for result in jacobians(lambda x: {"V": sp.se3_log(sp.se3_exp(x))}, V).values():
        assert_allclose(result["V"], np.tile(np.eye(6), (len(w), 1, 1)), atol=1e-11)


def test_log_at_exact_half_turn(x64):
    """Against ``2 atan2(|u|, q_w) u / |u|``, which goes on smoothly to more than half a turn."""

    def smooth(q):
        length = jnp.linalg.norm(q[1:])
        return {"log": 2 * jnp.arctan2(length, q[0]) / length * q[1:]}

    axes = np.concatenate([AXES, -AXES])
    q = np.concatenate([np.zeros((6, 1)), axes], axis=1)
    reference = central_differences(smooth, q)["log"]
    assert_allclose(jit(jax.vmap(sp.quat_log))(jnp.asarray(q)), np.pi * axes, atol=1e-15)
    for result in jacobians(lambda q: {"log": sp.quat_log(q)}, jnp.asarray(q)).values():
        assert_allclose(result["log"], reference, atol=1e-9)


def test_second_derivatives_at_zero(x64):
    """The series carries every order: the squared length of ``log(exp(w))`` has Hessian ``2``."""

    def squared(w):
        return jnp.sum(sp.quat_log(sp.quat_exp(w)) ** 2)

    assert_allclose(jit(jax.hessian(squared))(jnp.zeros(3)), 2 * np.eye(3), atol=1e-14)


def test_zero_quaternion_has_finite_derivatives():
    def functions(q):
        turned = sp.quat_integrate(q, jnp.zeros(3), 0.1)
        return {"normalize": sp.quat_normalize(q), "log": sp.quat_log(q), "integrate": turned}

    tiny = jnp.stack([jnp.zeros(4), 1e-17 * jnp.ones(4), 1e-12 * jnp.ones(4)])
    for result in jacobians(functions, tiny).values():
        assert all(jnp.isfinite(jacobian).all() for jacobian in result.values())
