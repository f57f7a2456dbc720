"""Options and flags that change the constraint problem, against MuJoCo."""

import pathlib

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from instants import batch_states, converging, evaluated, rollout
from oracle import assert_close, quick_jit
from scenes import FLOOR, PILE

import jaxsim
from jaxsim.engine.report import forward
from jaxsim.engine.stepping import evaluate
from jaxsim.io import load
from jaxsim.model import ModelError, make_state

# One of each kind: a limit, dry friction, an equality and a contact.
MIXED = """
<mujoco>
  <option timestep="0.01" o_margin=".02" o_solref=".05 .7"
    o_solimp=".8 .9 .01 .5 2" o_friction=".2 .2 .01 .001 .001"/>
  <worldbody>
    <geom type="plane" size="0 0 1" condim="1"/>
    <body pos="0 0 .095"><joint name="x" type="slide" axis="1 0 0" frictionloss=".5"/>
      <joint name="z" type="slide" axis="0 0 1" limited="true" range="0 1" margin=".01"
        solreflimit=".1 1"/>
      <joint name="y" type="slide" axis="0 1 0"/>
      <geom type="sphere" size=".1" condim="1" solref=".005 1"/></body>
  </worldbody>
  <equality><joint joint1="y" joint2="x" polycoef="0 1 0 0 0" solref=".005 1"/></equality>
</mujoco>
"""
ASSETS = pathlib.Path(jaxsim.__file__).parent / "assets"
DISABLE = "CONSTRAINT EQUALITY FRICTIONLOSS LIMIT CONTACT WARMSTART REFSAFE".split()


def test_flags_switch_what_they_name():
    expected, models, common = {}, {}, rollout(converging(MIXED), 8, 1, seed=2)
    for flag in [*DISABLE, "OVERRIDE"]:
        mj = converging(MIXED)
        if flag == "OVERRIDE":
            mj.opt.enableflags |= int(mujoco.mjtEnableBit.mjENBL_OVERRIDE)
        else:
            mj.opt.disableflags |= int(getattr(mujoco.mjtDisableBit, f"mjDSBL_{flag}"))
        expected[flag] = np.stack([evaluated(mj, d).qacc for d in common])
        models[flag] = load(mj)
    plain = np.stack([d.qacc for d in common])
    states, ctrl = batch_states(load(converging(MIXED)), common)

    def accelerations(models, state, ctrl):
        return {name: evaluate(m, state, ctrl).qacc for name, m in models.items()}

    got = quick_jit(jax.vmap(accelerations, (None, 0, 0)))(models, states, ctrl)
    for flag, qacc in got.items():
        assert_close(qacc, expected[flag], 1e-6, 1e-6, flag)
        # The comparison would be empty if a flag had no effect on the scene.
        assert flag == "WARMSTART" or np.abs(expected[flag] - plain).max() > 1e-3


@pytest.mark.parametrize("cone", [pytest.param("pyramidal", marks=pytest.mark.slow), "elliptic"])
def test_impratio_is_a_leaf(cone):
    mj = converging(FLOOR, cone)
    datas, model = rollout(mj, 4, 20, seed=4, spread=1.0), load(mj)
    states, ctrl = batch_states(model, datas)

    @quick_jit
    def solve(impratio):
        changed = model.replace(opt=model.opt.replace(impratio=impratio))
        return jax.vmap(lambda s, c: evaluate(changed, s, c).qacc)(states, ctrl)

    for impratio in (0.5, 1.0, 30.0):
        mj.opt.impratio = impratio
        expected = np.stack([evaluated(mj, d).qacc for d in datas])
        assert_close(solve(impratio), expected, 1e-6, 1e-6, f"impratio {impratio}")


def test_all_strategies_agree():
    mj = converging(FLOOR, "elliptic")
    model, datas = load(mj), rollout(mj, 6, 20)
    found = _by_strategy(model, datas, ("articulated", "dense", "iterative"))
    expected = np.stack([d.qacc for d in datas])
    for name, qacc in found.items():
        assert_close(qacc, expected, 1e-6, 1e-6, name)


@pytest.mark.parametrize("hessian", ["dense", "iterative"])
def test_without_constraints_strategies_have_derivatives(hessian, x64):
    """A reverse-mode derivative of an acceleration that is not constrained."""
    model = load("double_pendulum")
    state = make_state(model).replace(qvel=jnp.array([1.0, -2.0]))

    def total(model):
        return lambda qpos: forward(model, state.replace(qpos=qpos)).qacc.sum()

    qpos = jnp.array([0.3, 0.4])
    expected = quick_jit(jax.jacfwd(total(model)))(qpos)
    found = quick_jit(jax.grad(total(model.replace(hessian=hessian))))(qpos)
    np.testing.assert_allclose(found, expected, rtol=1e-10)


def test_coupled_rows_need_another_strategy_than_articulated():
    mj = converging(PILE)
    model, datas = load(mj), rollout(mj, 6, 20)
    found = _by_strategy(model, datas, ("iterative",))
    expected = np.stack([d.qacc for d in datas])
    assert_close(found["iterative"], expected, 1e-6, 1e-6)
    states, ctrl = batch_states(model, datas[:1])
    one = jax.tree.map(lambda x: x[0], states)
    with pytest.raises(ModelError, match=r"contact rows couple .*'auto', 'dense' or 'iterative'"):
        jax.eval_shape(forward, model.replace(hessian="articulated"), one, ctrl[0])


def _by_strategy(model, datas, strategies):
    def solve(state, ctrl):
        variants = {name: model.replace(hessian=name) for name in strategies}
        return {n: evaluate(m, state, ctrl).qacc for n, m in variants.items()}

    return quick_jit(jax.vmap(solve))(*batch_states(model, datas))


@pytest.mark.parametrize(
    ("name", "cone", "iterations"),
    [
        ("quadruped", "pyramidal", 1),
        pytest.param("humanoid", "elliptic", 1, marks=pytest.mark.slow),
        ("quadruped", "elliptic", 2),
    ],
)
def test_few_steps_end_where_mujocos_do(name, cone, iterations):
    """Warm starts, and line searches that are cut short, do not only lead to the same minimum."""
    mj = converging(str(ASSETS / f"{name}.xml"), cone)
    datas = rollout(mj, 40, 3, spread=1.0)
    warm = np.stack([datas[max(i - 1, 0)].qacc for i in range(len(datas))])
    for data, qacc in zip(datas, warm, strict=True):
        data.qacc_warmstart[:] = qacc
    evaluations = 4
    mj.opt.iterations, mj.opt.ls_iterations = iterations, evaluations
    model, expected = load(mj), [evaluated(mj, data) for data in datas]
    assert sum(data.solver[0].neval >= evaluations for data in expected) >= 5
    states, ctrl = batch_states(model, datas)
    states = states.replace(qacc_warmstart=jnp.asarray(warm))
    got = quick_jit(jax.vmap(forward, (None, 0, 0)))(model, states, ctrl)
    assert_close(got.qacc, np.stack([data.qacc for data in expected]), 1e-6, 1e-6)
