"""Linear systems with quadratic costs, for which the answers are known."""

import jax.numpy as jnp
import numpy as np

from jaxsim.trajopt import make_problem

HORIZON = 20
A = np.array([[1.0, 0.1, 0.0], [-0.2, 0.98, 0.1], [0.0, 0.05, 1.02]])
B = np.array([[0.0, 0.02], [0.1, 0.0], [0.05, 0.1]])
Q, R, FINAL = np.diag([1.0, 0.5, 2.0]), np.diag([0.1, 0.3]), 5 * np.eye(3)
START = np.array([1.0, -2.0, 0.5])


def problem(limits=None, horizon=HORIZON):
    """Minimise the sum of `x' Q x + u' R u` over 2, and `x' FINAL x` over 2 at the end."""
    return make_problem(
        lambda x, u: A @ x + B @ u,
        jnp.asarray(START),
        horizon=horizon,
        running_cost=lambda x, u, t: 0.5 * (x @ Q @ x + u @ R @ u),
        final_cost=lambda x: 0.5 * x @ FINAL @ x,
        control_limits=limits,
        nu=2,
    )


def riccati():
    """Gains (T, nu, n) and the matrix of the value at the start."""
    value, gains = FINAL, []
    for _ in range(HORIZON):
        gain = -np.linalg.solve(R + B.T @ value @ B, B.T @ value @ A)
        gains.append(gain)
        value = Q + A.T @ value @ (A + B @ gain)
    return np.array(gains[::-1]), value


def least_squares(start=START):
    """(M, c): the cost is `|M u + c|^2 / 2` of the controls as one vector."""
    powers = [np.linalg.matrix_power(A, k) for k in range(HORIZON + 1)]
    rows, constants = [], []
    for t in range(1, HORIZON + 1):
        weight = np.linalg.cholesky(FINAL if t == HORIZON else Q).T
        reach = [powers[t - 1 - s] @ B if s < t else np.zeros_like(B) for s in range(HORIZON)]
        rows.append(weight @ np.concatenate(reach, axis=1))
        constants.append(weight @ powers[t] @ start)
    effort = np.kron(np.eye(HORIZON), np.linalg.cholesky(R).T)
    constants.append(np.zeros(len(effort)))
    return np.concatenate([*rows, effort]), np.concatenate(constants)
