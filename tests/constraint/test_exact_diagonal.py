"""The flag `diagexact`: softness of rows by their exact inverse inertia, as MuJoCo's."""

import jax
import mujoco
import numpy as np
import pytest
from instants import DOUBLE, assert_instants, batch_states, converging, forward_all, rollout
from oracle import quick_jit
from scenes import SCENES

from jaxsim.engine.report import forward
from jaxsim.io import load

_FLAG = int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)


@pytest.mark.parametrize(
    ("scene", "cone"),
    [
        ("pile", "pyramidal"),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("pile", "elliptic"),
                ("floor", "pyramidal"),
                ("floor", "elliptic"),
                ("limits", "pyramidal"),
                ("equalities", "pyramidal"),
            )
        ),
    ],
)
def test_small_scenes(scene, cone, x64):
    mj = converging(SCENES[scene], cone)
    plain = rollout(mj, 1, 1, seed=1, spread=0.5)[0].qacc
    mj.opt.enableflags |= _FLAG
    datas = rollout(mj, 8, 15, seed=1, spread=0.5)
    assert np.abs(datas[0].qacc - plain).max() > 1e-3, "the flag matters"
    assert_instants(mj, datas, forward_all(load(mj), datas), DOUBLE)


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["pile", "equalities"])
def test_derivative(scene, x64):
    mj = converging(SCENES[scene], "pyramidal")
    mj.opt.enableflags |= _FLAG
    model = load(mj)
    data = rollout(mj, 2, 15, seed=1, spread=0.5)[1]
    state = jax.tree.map(lambda x: x[0], batch_states(model, [data])[0])
    along = np.random.default_rng(0).normal(size=mj.nq)

    def qacc(t):
        return forward(model, state.replace(qpos=state.qpos + t * along)).qacc

    both = quick_jit(lambda t: jax.jvp(qacc, (t,), (1.0,)))
    h = 1e-6
    slope = (both(h)[0] - both(-h)[0]) / (2 * h)
    np.testing.assert_allclose(both(0.0)[1], slope, rtol=1e-5, atol=1e-5 * np.abs(slope).max())
