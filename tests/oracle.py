"""What MuJoCo computes, stage by stage, under the names that `jaxsim` uses; and comparison."""

import functools
from collections.abc import Callable

import jax
import mujoco
import numpy as np

MATRICES = ("xmat", "ximat", "geom_xmat", "site_xmat")
POSITIONS = ("xpos", "xquat", "xipos", "geom_xpos", "site_xpos", "subtree_com")


def oracle_stages(mj: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> dict[str, np.ndarray]:
    """Kinematics, mass matrix, bias forces and energies at several states, stacked."""
    return stack([oracle_stage(mj, q, v) for q, v in zip(qpos, qvel, strict=True)])


def oracle_stage(mj: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> dict[str, np.ndarray]:
    """The same at one state."""
    data = at(mj, qpos, qvel)
    mujoco.mj_energyPos(mj, data)
    mujoco.mj_energyVel(mj, data)
    mujoco.mj_subtreeVel(mj, data)
    mass = np.zeros((mj.nv, mj.nv))
    mujoco.mj_fullM(mj, data, mass)
    stages = {name: getattr(data, name).copy() for name in POSITIONS}
    stages |= {name: getattr(data, name).reshape(-1, 3, 3).copy() for name in MATRICES}
    return stages | {
        "mass_matrix": mass,
        "qfrc_bias": data.qfrc_bias.copy(),
        "potential_energy": data.energy[0],
        "kinetic_energy": data.energy[1],
        "subtree_linvel": data.subtree_linvel.copy(),
        "subtree_angmom": data.subtree_angmom.copy(),
    }


def at(mj: mujoco.MjModel, qpos: np.ndarray, qvel: np.ndarray) -> mujoco.MjData:
    """Data after `mj_forward` at a state."""
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(mj, data)
    return data


def quick_jit(f: Callable, **options) -> Callable:
    """`jax.jit` that compiles several times faster and runs slower, for functions called once."""
    return jax.jit(f, compiler_options=_quick_options(), **options)


@functools.cache
def _quick_options() -> dict[str, bool | int]:
    """Compiler options; the newer code generator compiles slowly, not every JAX has a choice."""
    level = {"xla_backend_optimization_level": 0}
    older = level | {"xla_cpu_use_fusion_emitters": False}
    try:
        jax.jit(lambda x: x + 1, compiler_options=older)(1.0)
    except jax.errors.JaxRuntimeError:
        return level
    return older


def stack(records: list[dict]) -> dict[str, np.ndarray]:
    """One record of arrays with a leading axis from records of equal shapes."""
    return {name: np.stack([r[name] for r in records]) for name in records[0]}


def assert_close(actual, expected, atol: float, rtol: float, what: str = "") -> None:
    """Agreement up to `atol + rtol * |expected|`, where the norm is the whole vector's.

    The leading axis counts states; each has a norm of its own.
    """
    actual, expected = np.asarray(actual), np.asarray(expected)
    assert actual.shape == expected.shape, what
    assert np.isfinite(actual).all(), what
    for a, e in zip(actual, expected, strict=True):
        error = np.abs(a - e).max(initial=0)
        assert error <= atol + rtol * np.linalg.norm(e), f"{what}: off by {error:.3g}"
