"""Geoms and pairs with adhesion pull as MuJoCo's, in contact and across the gap."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.model import ModelError

# Pressed, across a gap, out of reach and by priority; two bodies that stick to each other.
XML = """
<mujoco><option cone="{cone}" tolerance="0" iterations="100" impratio="2"><flag {flag}/></option>
<default><geom condim="{condim}" friction=".5 .01 .02" mass="1"/></default><worldbody>
  <geom name="wall" type="plane" size="0 0 1" adhesion="1" gap=".02"/>
  <body pos="0 0 .0999"><freejoint/><site name="s"/><geom size=".1" adhesion="3" margin=".001"/>
    <body pos=".3 0 .08"><joint axis="0 1 0"/><geom size=".1" condim="1" adhesion="2"/></body>
  </body>
  <body pos="1 0 .11"><freejoint/><geom size=".1" adhesion="3" gap=".01"/></body>
  <body pos="2 0 .14"><freejoint/><geom size=".1" adhesion="3" gap=".01"/></body>
  <body pos="3 0 .1"><freejoint/><geom size=".1" priority="1" adhesion="7"/></body>
  <body pos="4 0 .098"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body pos="5 0 .105"><freejoint/><geom name="p" size=".1" adhesion="9"/>
    <body pos="0 0 .2"><joint axis="1 0 0"/><geom size=".1" adhesion="1"/></body></body>
</worldbody>
<contact><pair geom1="wall" geom2="p" condim="{condim}" adhesion="5" gap=".02"/></contact>
<sensor><contact geom1="wall" data="found force" num="3"/><touch site="s"/></sensor></mujoco>
"""


def _model(cone, condim, flag="diagexact='disable'") -> mujoco.MjModel:
    xml = XML.format(cone=cone, condim=condim, flag=flag)
    return mujoco.MjModel.from_xml_string(xml)


@pytest.mark.parametrize(
    ("cone", "condim", "flag"),
    [
        ("pyramidal", 3, "energy='enable'"),
        ("elliptic", 6, "energy='enable'"),
        *(
            pytest.param(*case, marks=pytest.mark.slow)
            for case in (
                ("elliptic", 1, "energy='enable'"),
                ("pyramidal", 4, "diagexact='enable'"),
                ("pyramidal", 6, "energy='enable'"),
                ("elliptic", 3, "diagexact='enable'"),
                ("elliptic", 4, "override='enable'"),
            )
        ),
    ],
)
def test_agreement_with_mujoco(cone, condim, flag, x64):
    mj = _model(cone, condim, flag)
    model, data, rng = jaxsim.load(mj), mujoco.MjData(mj), np.random.default_rng(0)

    @quick_jit
    def found(qpos, qvel):
        return jaxsim.forward(model, jaxsim.make_state(model).replace(qpos=qpos, qvel=qvel))

    apart = 0
    for k in range(6):
        mujoco.mj_resetData(mj, data)
        data.qvel[:] = rng.normal(size=mj.nv) * 0.1
        mujoco.mj_step(mj, data, 3 * k)
        mujoco.mj_forward(mj, data)
        apart += np.sum(data.contact.dist > data.contact.includemargin)
        got = found(jnp.array(data.qpos), jnp.array(data.qvel))
        for name in ("qacc", "qfrc_passive", "qfrc_constraint", "sensordata"):
            np.testing.assert_allclose(getattr(got, name), getattr(data, name), 1e-8, 1e-8, name)
        assert int(got.contact.active.sum()) == np.sum(data.contact.efc_address >= 0)
    assert apart > 3


@pytest.mark.parametrize("cone", ["elliptic", pytest.param("pyramidal", marks=pytest.mark.slow)])
def test_derivatives(cone, x64):
    """By the adhesion of geoms and pairs, in both modes, and by differences."""
    model = jaxsim.load(_model(cone, 3))
    state = jaxsim.make_state(model)

    def total(scale):
        sticky = model.replace(
            geom_adhesion=scale * model.geom_adhesion, pair_adhesion=scale * model.pair_adhesion
        )
        return jnp.sum(jnp.sin(jaxsim.forward(sticky, state).qacc))

    value = quick_jit(lambda s: (total(s), jax.grad(total)(s), jax.jvp(total, (s,), (1.0,))[1]))
    h = 1e-5
    slope = (value(1 + h)[0] - value(1 - h)[0]) / (2 * h)
    np.testing.assert_allclose(value(1.0)[1:], slope, rtol=1e-6)


@pytest.mark.slow
def test_a_ball_hangs_from_a_ceiling_up_to_its_adhesion():
    xml = """<mujoco><worldbody>
      <geom type="plane" size="0 0 1" euler="180 0 0" adhesion="{}" gap=".02"/>
      <body pos="0 0 -.1"><freejoint/><geom size=".1" mass="1"/></body></worldbody></mujoco>"""
    for adhesion, hangs in ((10.5, True), (9.0, False)):
        model = jaxsim.load(xml.format(adhesion))
        state = jaxsim.make_state(model)
        state = state.replace(qpos=state.qpos.at[2].set(-0.0995))
        final, _ = jaxsim.rollout(model, state, jnp.zeros((200, 0)))
        assert (abs(final.qpos[2] + 0.1) < 0.01) == hangs


def test_what_it_does_not_combine_with():
    with pytest.raises(ModelError, match="contact='sap' does not combine with adhesion"):
        jaxsim.load(_model("elliptic", 3), contact="sap")
    with pytest.raises(ModelError, match="does not combine with adhesion"):
        jaxsim.load(_model("elliptic", 3), backward=jaxsim.gradients.Backward(entry_time=True))
