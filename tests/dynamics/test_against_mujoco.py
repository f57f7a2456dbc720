"""Every model of other packages: one instant at random states, stage by stage."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from assets import UNSUPPORTED, asset_files
from oracle import MATRICES, POSITIONS, assert_close, at, oracle_stages, quick_jit
from random_models import binary_tree, chain, forest, random_model, random_states, star

import jaxsim
from jaxsim.dynamics.aba import solve_mass
from jaxsim.dynamics.crba import composite_mass_matrix
from jaxsim.dynamics.kinematics import kinematics
from jaxsim.dynamics.rnea import qfrc_bias
from jaxsim.dynamics.velocity import velocities
from jaxsim.io import build, load
from jaxsim.model import ModelError, make_state
from jaxsim.quantities.energy import kinetic_energy, potential_energy
from jaxsim.quantities.momentum import subtree_velocities

FILES = asset_files()

# Between them: all joint types, several trees, mocap, no joints at all, welded bodies, tendons.
SAMPLE = (
    "gymnasium:humanoid.xml",
    "gymnasium:pusher.xml",
    "mujoco.mjx:convex.xml",
    "mujoco.mjx:pendula.xml",
    "mujoco.mjx:ray.xml",
    "mujoco.mjx:tendon/fixed.xml",
)
SINGLE = ("gymnasium:ant.xml", "mujoco.mjx:pendula.xml")

SHAPES = {
    "chain of 5": lambda: chain(5),
    "chain of 40": lambda: chain(40, "slide"),
    "chain of 512": lambda: chain(512),
    "binary tree": lambda: binary_tree(31),
    "star": lambda: star(60),
    "equal chains": lambda: forest(3, 20),
    "no joints": lambda: chain(0),
    "one free body": lambda: star(0),
    "trees on mocap bodies and on the world": lambda: mujoco.MjModel.from_xml_string(
        random_model(0, bodies=4, trees=3, mocap=True, multiple=False)
    ),
}

LARGE = ("chain of 512", "binary tree", "star", "equal chains")

# Absolute and relative tolerances in float64 and float32.
TOLERANCES = {
    **dict.fromkeys((*POSITIONS, *MATRICES), ((1e-12, 1e-12), (1e-5, 1e-4))),
    "mass_matrix": ((1e-12, 1e-11), (1e-7, 1e-5)),
    "qfrc_bias": ((1e-10, 1e-10), (1e-3, 1e-4)),
    "qacc_smooth": ((1e-9, 1e-9), (1e-2, 1e-3)),
    "potential_energy": ((1e-10, 1e-10), (1e-3, 1e-4)),
    "kinetic_energy": ((1e-10, 1e-10), (1e-3, 1e-4)),
    "subtree_linvel": ((1e-11, 1e-11), (1e-4, 1e-4)),
    "subtree_angmom": ((1e-10, 1e-10), (1e-3, 1e-4)),
}


@pytest.mark.parametrize("name", FILES)
def test_model_loads_or_says_why_not(name):
    reason = _refusal(load, FILES[name])
    assert reason is None or any(known in reason for known in UNSUPPORTED)


def _refusal(read, source) -> str | None:
    """Why a model is refused, None if it is not."""
    try:
        read(source)
    except ModelError as error:
        return str(error)
    return None


@pytest.mark.parametrize(
    "name", [n if n in SAMPLE else pytest.param(n, marks=pytest.mark.slow) for n in FILES]
)
def test_float64(name):
    _compare_file(name, precision=0)


@pytest.mark.parametrize(
    "name", [n if n in SINGLE else pytest.param(n, marks=pytest.mark.slow) for n in FILES]
)
def test_float32(name):
    with jax.enable_x64(False):
        _compare_file(name, precision=1)


@pytest.mark.parametrize(
    "shape", [s if s not in LARGE else pytest.param(s, marks=pytest.mark.slow) for s in SHAPES]
)
def test_shapes_of_trees(shape):
    _compare(SHAPES[shape](), precision=0)


def _compare_file(name: str, precision: int):
    mj = mujoco.MjModel.from_xml_path(str(FILES[name]))
    # The smooth dynamics do not ask whether the geoms' contacts are supported.
    if _refusal(build, mj) is None:
        _compare(mj, precision)


def _compare(mj: mujoco.MjModel, precision: int):
    model = build(mj)
    qpos, qvel = random_states(mj, seed=0, n=8)
    data = [at(mj, q, v) for q, v in zip(qpos, qvel, strict=True)]
    force = np.stack([d.qfrc_smooth for d in data])
    theirs = oracle_stages(mj, qpos, qvel) | {
        "qacc_smooth": np.stack([d.qacc_smooth for d in data])
    }
    ours = quick_jit(jax.vmap(_stages, in_axes=(None, 0, 0, 0)))(model, qpos, qvel, force)
    for stage, tolerances in TOLERANCES.items():
        assert_close(ours[stage], theirs[stage], *tolerances[precision], stage)


def _stages(model, qpos, qvel, qfrc_smooth):
    state = make_state(model)
    kin = kinematics(model, qpos, state.mocap_pos, state.mocap_quat)
    vel = velocities(model, kin, qvel)
    linvel, angmom = subtree_velocities(model, kin, vel)
    stages = {name: getattr(kin, name) for name in (*POSITIONS, *MATRICES)}
    return stages | {
        "mass_matrix": composite_mass_matrix(model, kin),
        "qfrc_bias": qfrc_bias(model, kin, vel),
        "qacc_smooth": solve_mass(model, kin, qfrc_smooth),
        "potential_energy": potential_energy(model, kin, qpos),
        "kinetic_energy": kinetic_energy(model, kin, vel, qvel),
        "subtree_linvel": linvel,
        "subtree_angmom": angmom,
    }


def test_mocap_bodies_stand_where_the_model_has_them(x64):
    """What takes `qpos` alone, of a slide along an axis that a mocap body has turned."""
    mj = mujoco.MjModel.from_xml_string("""
      <mujoco><worldbody><body mocap="true" euler="90 0 0"><body><joint type="slide"/>
        <geom size=".1"/></body></body></worldbody></mujoco>""")
    model, zero = load(mj), jnp.zeros(1)
    data = at(mj, np.zeros(1), np.zeros(1))
    np.testing.assert_allclose(jaxsim.inverse_dynamics(model, zero, zero, zero), data.qfrc_bias)
    np.testing.assert_allclose(jaxsim.mass_matrix(model, zero)[0], mj.body_mass[2], rtol=1e-12)
