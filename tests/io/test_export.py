"""`to_mujoco`: MuJoCo computes with the exported model what it computes with its own."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim

# Two fields of the reference configuration that a float32 model has rounded.
NAMES = "humanoid", "arm", "four_bar", "spheres", "quadruped"


def accelerations(mj: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    oracle = mujoco.MjData(mj)
    oracle.qpos[:], oracle.qvel[:], oracle.ctrl[:] = data.qpos, data.qvel, data.ctrl
    oracle.xfrc_applied[:] = data.xfrc_applied
    mujoco.mj_forward(mj, oracle)
    return oracle.qacc


@pytest.mark.parametrize("name", NAMES)
def test_an_unchanged_model_comes_back(name, bundled, x64, rng):
    source = bundled(name)
    model = jaxsim.load(source)
    state = jaxsim.make_state(model)
    state = state.replace(
        qvel=jnp.asarray(rng.normal(size=source.nv)),
        xfrc_applied=jnp.asarray(rng.normal(size=(source.nbody, 6))),
    )
    mj, data = jaxsim.to_mujoco(model, state, rng.normal(size=source.nu))
    assert mj is not source
    assert [mj.geom(i).name for i in range(mj.ngeom)] == [
        source.geom(i).name for i in range(source.ngeom)
    ]
    np.testing.assert_array_equal(mj.geom_rgba, source.geom_rgba)
    np.testing.assert_allclose(data.qacc, accelerations(source, data), rtol=1e-9, atol=1e-9)


def test_changed_numbers_are_those_that_mujoco_uses(x64, rng):
    xml = """<mujoco><worldbody>
      <body pos="0 0 1"><joint axis="0 1 0" damping="1"/><geom size=".1" pos=".5 0 0"/>
        <body pos="1 0 0"><joint axis="0 1 0"/><geom type="capsule" size=".05 .3"/></body>
      </body></worldbody></mujoco>"""
    model = jaxsim.load(xml)
    heavier = model.replace(
        body_mass=model.body_mass * 2,
        dof_damping=model.dof_damping + 0.5,
        body_ipos=model.body_ipos.at[2, 0].add(0.2),  # the compiler had it in the body's frame
        opt=model.opt.replace(gravity=jnp.array([0.0, 0, -3])),
    )
    mj, data = jaxsim.to_mujoco(heavier, jaxsim.make_state(heavier))
    assert mj.body_mass[1] == 2 * float(model.body_mass[1])
    ours = jax.jit(jaxsim.forward)(heavier, jaxsim.make_state(heavier))
    np.testing.assert_allclose(data.qacc, ours.qacc, rtol=1e-9)


def test_a_body_that_mujoco_took_for_simple_keeps_its_frame():
    ball = "<body name='ball'><freejoint/><geom size='.1'/></body>"
    model = jaxsim.load(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    with pytest.raises(jaxsim.ModelError, match="'ball': its centre of mass"):
        jaxsim.to_mujoco(model.replace(body_ipos=model.body_ipos + 0.1))


def test_a_batch_is_refused():
    model = jaxsim.load("pendulum")
    states = jax.vmap(lambda _: jaxsim.make_state(model))(jnp.arange(2))
    with pytest.raises(ValueError, match="one environment: qpos must have shape"):
        jaxsim.to_mujoco(model, states)
    with pytest.raises(ValueError, match="one environment: body_mass"):
        jaxsim.to_mujoco(model.replace(body_mass=jnp.stack([model.body_mass] * 2)))
