"""Constrained problems: taken from MuJoCo scenes, and random."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from dense_operator import DenseOperator

from jaxsim.solver import (
    EllipticCone,
    Huber,
    Problem,
    Quadratic,
    Unilateral,
    solve,
)

# Contacts take the larger condim of their geoms: here there is one of 1, 4 and 6 and four of 3.
SCENE = """
<mujoco>
  <option solver="Newton" tolerance="0" iterations="100" jacobian="dense" cone="{cone}"
    impratio="{impratio}"><flag island="disable"/></option>
  <default><geom condim="1" friction="0.7 0.02 0.001"/></default>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 0.095" euler="3 5 0">
      <freejoint/>
      <geom type="box" size="0.1 0.2 0.1" mass="3" condim="3"/>
      <body pos="0.2 0 0.1">
        <joint name="a" type="hinge" axis="0 1 0" range="-10 10" frictionloss="0.4"/>
        <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.03" mass="0.5"/>
        <body pos="0.3 0 0">
          <joint name="b" type="hinge" axis="0 1 0" range="-10 10" frictionloss="0"/>
          <joint name="c" type="slide" axis="1 0 0" frictionloss="2"/>
          <geom type="sphere" size="0.05" mass="0.2"/>
        </body>
      </body>
    </body>
    <body pos="0.05 0.05 0.283"><freejoint/>
      <geom type="sphere" size="0.09" mass="1" condim="6"/></body>
    <body pos="1 0 0.089"><freejoint/><geom type="sphere" size="0.09" mass="1" condim="4"/></body>
    <body pos="2 0 0.089"><freejoint/><geom type="sphere" size="0.09" mass="1"/></body>
  </worldbody>
  <equality><joint joint1="b" joint2="c"/></equality>
</mujoco>
"""


class Case(NamedTuple):
    """A problem with MuJoCo's answer."""

    problem: Problem
    operator: DenseOperator
    force: jax.Array
    x_warm: jax.Array
    scale: float
    qacc: np.ndarray
    forces: tuple[np.ndarray, ...]
    cost: float


def problem_of(model: mujoco.MjModel, data: mujoco.MjData) -> Case:
    """MuJoCo's constraint rows, one block for each cost kind and dimension."""
    nv, dtype = model.nv, jnp.zeros(()).dtype
    mass = np.zeros((nv, nv))
    mujoco.mj_fullM(model, data, mass)
    jacobian = data.efc_J.reshape(data.nefc, nv)
    kinds = data.efc_type
    elliptic = kinds == int(mujoco.mjtConstraint.mjCNSTR_CONTACT_ELLIPTIC)
    order = np.arange(data.nefc)
    rows = [
        order[: data.ne],
        order[data.ne : data.ne + data.nf],
        order[(order >= data.ne + data.nf) & ~elliptic],
    ]
    as_array = lambda a: jnp.asarray(a, dtype)  # noqa: E731
    aref, D = as_array(data.efc_aref), as_array(data.efc_D)
    blocks = [
        Quadratic(aref[rows[0]], D[rows[0]]),
        Huber(aref[rows[1]], D[rows[1]], as_array(data.efc_frictionloss[rows[1]])),
        Unilateral(aref[rows[2]], D[rows[2]]),
    ]
    contacts = [c for c in data.contact if elliptic[c.efc_address]] if elliptic.any() else []
    for dim in sorted({c.dim for c in contacts}):
        chosen = [c for c in contacts if c.dim == dim]
        rows.append(np.stack([c.efc_address + np.arange(dim) for c in chosen]))
        mu = as_array([c.mu for c in chosen])
        coefficients = as_array([c.friction[: dim - 1] for c in chosen])
        blocks.append(EllipticCone(aref[rows[-1]], D[rows[-1]], mu, coefficients))
    cost = np.zeros(1)
    mujoco.mj_constraintUpdate(model, data, jacobian @ data.qacc - data.efc_aref, cost, 0)
    force = mass @ data.qacc_smooth
    return Case(
        problem=Problem(tuple(blocks)),
        operator=DenseOperator(as_array(mass), tuple(as_array(jacobian[r]) for r in rows)),
        force=as_array(force),
        x_warm=as_array(data.qacc_warmstart),
        scale=1 / np.trace(mass),
        qacc=data.qacc.copy(),
        forces=tuple(data.efc_force[r] for r in rows),
        cost=float(cost[0] + 0.5 * data.qacc @ mass @ data.qacc - force @ data.qacc),
    )


@pytest.fixture
def scene():
    """Function (cone, impratio) to the Case of a scene with every kind of row."""

    def build(cone: str, impratio: float) -> Case:
        model = mujoco.MjModel.from_xml_string(SCENE.format(cone=cone, impratio=impratio))
        data = mujoco.MjData(model)
        data.qpos[7:10] = 0.3, -0.2, 0.01
        data.qvel[:] = np.random.default_rng(1).normal(size=model.nv)
        data.qacc_warmstart[:] = 1.0
        mujoco.mj_forward(model, data)
        return problem_of(model, data)

    return build


@pytest.fixture
def random_case():
    """Function (seed, nv) to (problem, operator, force) with a block of each kind."""

    def build(seed: int, nv: int = 7):
        rng = np.random.default_rng(seed)
        dtype = jnp.zeros(()).dtype

        def normal(*shape):
            return jnp.asarray(rng.normal(size=shape), dtype)

        def positive(*shape):
            return jnp.asarray(rng.uniform(0.3, 2.0, size=shape), dtype)

        blocks = [
            Quadratic(normal(2), positive(2)),
            Huber(normal(2, 2), positive(2, 2), positive(2, 2)),
            Unilateral(normal(5), positive(5)),
            cone(normal, positive, 4, 3),
        ]
        factor = normal(nv, nv)
        mass = factor @ factor.T + 0.5 * jnp.eye(nv, dtype=dtype)
        jacobian = tuple(normal(*block.aref.shape, nv) for block in blocks)
        return Problem(tuple(blocks)), DenseOperator(mass, jacobian), mass @ (2 * normal(nv))

    return build


def cone(normal, positive, n: int, d: int) -> EllipticCone:
    """Random contacts with the regularisation that MuJoCo chooses."""
    mu, friction, stiffness = positive(n), positive(n, d - 1), positive(n)
    tangential = (stiffness / mu**2)[:, None] * friction**2
    D = jnp.concatenate([stiffness[:, None], tangential], axis=1)
    return EllipticCone(normal(n, d), D, mu, friction)


@pytest.fixture
def random_cone():
    """Function (seed, n, d) to random contacts."""

    def build(seed: int, n: int, d: int) -> EllipticCone:
        rng = np.random.default_rng(seed)
        dtype = jnp.zeros(()).dtype
        normal = lambda *s: jnp.asarray(rng.normal(size=s), dtype)  # noqa: E731
        positive = lambda *s: jnp.asarray(rng.uniform(0.3, 2.0, size=s), dtype)  # noqa: E731
        return cone(normal, positive, n, d)

    return build


compiled_solve = jax.jit(solve, static_argnames=("iterations", "ls_iterations"))
TIGHT = {"iterations": 100, "ls_iterations": 50, "tolerance": 0.0, "ls_tolerance": 0.01, "scale": 1}


@pytest.fixture
def solve_tight():
    """Function (problem, operator, force, x_start) to the converged solution."""

    def build(problem, operator, force, x_start=None, **changes):
        start = jnp.zeros_like(force) if x_start is None else x_start
        return compiled_solve(problem, operator, force, start, **(TIGHT | changes))

    return build
