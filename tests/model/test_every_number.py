"""The derivative of a step by every number of a model, against differences of MuJoCo's step."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.model.presence import OPTIONAL_FORCES

XML = """
<mujoco>
  <compiler angle="radian"/>
  <option density="300" viscosity=".2" wind="1 2 3" magnetic="1 2 3" gravity="1 2 -9"
    tolerance="0" iterations="100" ls_iterations="100" cone="elliptic" impratio="2"/>
  <default><geom margin=".01" gap=".001" friction=".7 .01 .02" condim="6"/></default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <site name="w" pos="-.2 .3 .6"/>
    <body name="ball" pos="0 1 .099"><freejoint/><geom size=".1"/>
      <geom size=".05" pos=".03 .02 .01"/><site name="s" pos=".05 0 .02"/></body>
    <body name="a" pos="0 0 .5" gravcomp=".3">
      <joint name="a" axis="0 1 .3" stiffness="3" damping=".4" springref=".1" armature=".02"
        frictionloss=".3" range="-.2 .1" margin=".1" limited="true"/>
      <geom type="capsule" size=".04 .2" pos=".2 0 .01" euler=".2 1.4 0"/>
      <geom name="g" size=".05" pos=".1 .2 .1" contype="0" conaffinity="0"/>
      <body name="b" pos=".4 0 0" euler=".2 .3 .5">
        <joint name="b" type="slide" axis="1 2 3" damping=".5" pos=".1 0 .1" range="-.1 .1"
          limited="true" margin=".09"/>
        <geom type="box" size=".05 .06 .07" pos=".02 0 .03"/><site name="e" pos=".1 0 0"/>
        <body name="c" pos=".2 .1 0"><joint name="c" type="ball" damping=".2" stiffness="1"/>
          <geom type="ellipsoid" size=".05 .06 .08" pos=".1 0 0" fluidshape="ellipsoid"/></body>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="f" stiffness="2" damping=".1" frictionloss=".1" springlength=".02"
      range="-.1 .02" limited="true" margin=".05">
      <joint joint="a" coef="1"/><joint joint="b" coef="-2"/></fixed>
    <spatial name="t" stiffness="20" damping=".3" springlength=".1">
      <site site="w"/><geom geom="g"/><site site="e"/></spatial>
  </tendon>
  <equality>
    <connect body1="c" body2="ball" anchor=".1 .2 .3" solref=".05 1"/>
    <joint joint1="a" joint2="b" polycoef=".01 .2 .3 .4 .5"/>
  </equality>
  <actuator>
    <general joint="a" gear="2" dyntype="filter" dynprm=".05" gaintype="affine" gainprm="1 2 3"
      biastype="affine" biasprm=".1 .2 .3" damping=".1" armature=".01"/>
    <position joint="b" kp="3" kv=".2" ctrlrange="-1 1"/>
    <muscle tendon="t" ctrlrange="0 1"/>
  </actuator>
</mujoco>
"""
# What ends MuJoCo's solver or lets it skip pairs, where it expands motion, and what it has not.
UNCOMPARED = (
    *("tolerance", "geom_rbound", "body_subtreemass"),
    *("geom_stiffness", "geom_relaxation", "geom_restitution", "body_cable", "actuator_pid"),
)
MOVED = 40  # at least so many arrays change the motion
STEP = 1e-6
QPOS0 = mujoco.MjModel.from_xml_string(XML).qpos0.copy()


def compiled() -> mujoco.MjModel:
    """The model, without marks by which MuJoCo leaves out numbers that were zero or equal."""
    mj = mujoco.MjModel.from_xml_string(XML)
    marks = (
        mj.body_sameframe,
        mj.geom_sameframe,
        mj.site_sameframe,
        mj.body_simple,
        mj.dof_simplenum,
    )
    for mark in marks:
        mark[:] = 0
    return mj


def start(mj: mujoco.MjModel) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(1)
    return {
        "qpos": QPOS0 + np.r_[np.zeros(7), 0.05, 0.03, 0.1, 0.05, 0.02, 0.01],
        "qvel": rng.normal(size=mj.nv) * 0.3,
        "act": rng.uniform(0.2, 0.5, mj.na),
    }


def weighted(qpos, qvel, act, weights):
    return sum(w @ x for w, x in zip(weights, (qpos, qvel, act), strict=True))


def oracle(mj, weights) -> float:
    data = mujoco.MjData(mj)
    for name, value in start(mj).items():
        getattr(data, name)[:] = value
    data.ctrl[:] = 0.3
    mujoco.mj_step(mj, data)
    return weighted(data.qpos, data.qvel, data.act, weights)


@pytest.mark.slow
@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_derivative_of_a_step_by_every_number(integrator, x64):
    mj = compiled()
    mj.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator.upper()}")
    rng = np.random.default_rng(0)
    weights = [rng.normal(size=n) for n in (mj.nq, mj.nv, mj.na)]
    model = jaxsim.load(mj)
    state = jaxsim.make_state(model).replace(**{k: jnp.array(v) for k, v in start(mj).items()})

    def loss(model):
        after = jaxsim.step(model, state, jnp.full(mj.nu, 0.3))
        return weighted(after.qpos, after.qvel, after.act, weights)

    value, slopes = quick_jit(jax.value_and_grad(loss, allow_int=True))(model)
    np.testing.assert_allclose(value, oracle(mj, weights), rtol=1e-9)
    moved = 0
    for path, slope in jax.tree_util.tree_leaves_with_path(slopes):
        names = tuple(key.name for key in path)
        if names[-1] in UNCOMPARED or slope.dtype == jax.dtypes.float0 or not slope.size:
            continue
        found, expected = difference(mj, names, np.asarray(slope), rng, weights)
        np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5, err_msg=str(names))
        moved += expected != 0
    assert moved > MOVED


def difference(mj, names, slope, rng, weights):
    """The derivative along a random direction, and MuJoCo's central difference."""
    owner = mj
    for name in names[:-1]:
        owner = getattr(owner, name)
    field = getattr(owner, names[-1])
    before = np.array(field, float)
    way = rng.normal(size=before.shape)
    # Zeros among these are marks that there is none.
    if ".".join(names) in (*OPTIONAL_FORCES, "geom_fluid"):
        way = way * (before != 0)
    slope = float((slope.reshape(way.shape) * way).sum())
    # Axes and quaternions are directions for us, and must be normalised for MuJoCo.
    if "quat" in names[-1] or names[-1] == "jnt_axis":
        way -= before * (before * way).sum(-1, keepdims=True)
    ends = []
    for t in (STEP, -STEP, 0):
        if before.ndim:
            field[...] = before + t * way
        else:
            setattr(owner, names[-1], float(before + t * way))
        ends.append(oracle(mj, weights))
    return slope, (ends[0] - ends[1]) / (2 * STEP)
