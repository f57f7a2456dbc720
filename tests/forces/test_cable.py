"""Elastic cables."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim

PLUGIN = '<extension><plugin plugin="mujoco.elasticity.cable"/></extension>'
CONFIG = """<plugin plugin="mujoco.elasticity.cable"><config key="twist" value="{}"/>
  <config key="bend" value="4e6"/><config key="flat" value="{}"/></plugin>"""


def cable(geom: str, flat: str = "false", twist: float = 1e7, initial: str = "ball") -> str:
    return f"""<mujoco><option gravity="0 0 -9.81"/>{PLUGIN}<worldbody>
    <composite type="cable" curve="s cos(s) sin(s)" count="7 1 1" size=".4 .1 .5"
     initial="{initial}" offset="0 0 1">{CONFIG.format(twist, flat)}
    <joint kind="main" damping=".01"/>{geom}</composite>
    </worldbody></mujoco>"""


ROUND = '<geom type="capsule" size=".006" contype="0" conaffinity="0"/>'
FLAT = '<geom type="box" size=".01 .004 .009" contype="0" conaffinity="0"/>'


@pytest.mark.parametrize(
    "xml",
    [cable(ROUND), cable(FLAT, "true"), cable(ROUND, initial="free"), cable(FLAT, initial="none")],
)
def test_forces_and_accelerations_are_those_of_mujoco(xml, rng):
    """To rounding: the plugin is a formula."""
    mj = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(mj)
    model = jaxsim.load(mj)
    mujoco.mj_integratePos(mj, data.qpos, 0.5 * rng.normal(size=mj.nv), 1)
    data.qvel[:] = rng.normal(size=mj.nv)
    mujoco.mj_forward(mj, data)
    state = jaxsim.make_state(model).replace(qpos=jnp.array(data.qpos), qvel=jnp.array(data.qvel))
    found = jax.jit(lambda s: jaxsim.forward(model, s))(state)
    size = float(np.linalg.norm(data.qacc))
    np.testing.assert_allclose(found.qacc, data.qacc, atol=1e-9 * size)
    assert np.abs(data.qfrc_passive).max() > 1e-3
    assert np.abs(data.qfrc_passive + 0.01 * data.qvel).max() > 1e-3


def test_stiffness_is_a_leaf(rng):
    """The forces are linear in it, and finite at rest."""
    model = jaxsim.load(mujoco.MjModel.from_xml_string(cable(ROUND)))
    assert (np.asarray(model.body_cable)[2:] > 0).all()
    state = jaxsim.make_state(model)
    state = state.replace(qpos=state.qpos + 0.1 * rng.normal(size=model.nq))

    def change(scale, qpos):
        other = model.replace(body_cable=scale * model.body_cable)
        return jaxsim.forward(other, state.replace(qpos=qpos)).qacc

    zero, one, two = jax.jit(jax.vmap(change, (0, None)))(jnp.arange(3.0), state.qpos)
    np.testing.assert_allclose(two - one, one - zero, atol=1e-9 * np.abs(one).max())
    assert np.abs(one - zero).max() > 1
    at_rest = jaxsim.make_state(model).qpos
    assert np.isfinite(jax.jit(jax.jacobian(change, 1))(1.0, at_rest)).all()


def test_what_is_no_cable_is_refused():
    config = CONFIG.format(1e7, "false")
    body = f"""<body name="{{}}" pos=".1 0 0">{config}<joint type="{{}}"/>
      <geom type="capsule" size=".01 .05"/>"""
    hinge = f"""<mujoco>{PLUGIN}<worldbody>{body.format("a", "ball")}{body.format("b", "hinge")}
    </body></body></worldbody></mujoco>"""
    hinge = hinge.replace(config, '<plugin instance="i"/>').replace(
        PLUGIN,
        """<extension><plugin plugin="mujoco.elasticity.cable"><instance name="i">
        <config key="twist" value="1e7"/><config key="bend" value="4e6"/></instance></plugin>
        </extension>""",
    )
    with pytest.raises(jaxsim.ModelError, match="body 'b': a body of a cable needs a ball joint"):
        jaxsim.load(mujoco.MjModel.from_xml_string(hinge))
