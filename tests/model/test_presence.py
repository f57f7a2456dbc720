"""Forces that were zero when a model was loaded: their numbers count as soon as they change."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.model.presence import OPTIONAL_FORCES

# One of everything that may have an optional force, and none of the forces.
XML = """
<mujoco>
  <option integrator="{integrator}"/>
  <worldbody>
    <body pos="0 0 1"><joint name="a" axis="0 1 0"/><geom size=".1 .2" type="capsule" pos=".3 0 0"/>
      <body pos=".6 0 0"><joint name="b" axis="0 1 0"/>
        <geom name="box" size=".1 .05 .2" type="box"/></body>
    </body>
  </worldbody>
  <tendon><fixed name="t"><joint joint="a" coef="1"/><joint joint="b" coef="-.5"/></fixed></tendon>
  <actuator><motor joint="a"/><motor tendon="t"/></actuator>
</mujoco>
"""
FLOOR = """<contact><pair geom1="floor" geom2="box" gap=".2" adhesion="1"/></contact><worldbody>
  <geom name="floor" type="plane" size="1 1 1" pos="0 0 .702"/>"""
VALUES = {
    "opt.density": 900.0,
    "opt.viscosity": 0.7,
    "body_gravcomp": [0, 0.3, 0.6],
    "dof_frictionloss": [0.4, 0.2],
    "geom_adhesion": [50.0, 0, 0],
    "geom_surfacevel": [[0.3, 0.2, 0, 0, 0, 1], [0] * 6, [0] * 6],
    "pair_adhesion": [0.7],
    "tendon_armature": [0.6],
    "tendon_damping": [0.8],
    "tendon_dampingpoly": [[0.3, 0.1]],
    "tendon_frictionloss": [0.5],
    "actuator_armature": [0.3, 0.4],
    "actuator_damping": [0.2, 0.7],
    "actuator_dampingpoly": [[0.1, 0.2], [0.3, 0.1]],
}


def put(model: jaxsim.Model, name: str, value) -> jaxsim.Model:
    field, _, option = name.partition(".")
    if option:
        return model.replace(opt=model.opt.replace(**{option: value}))
    return model.replace(**{field: value})


def moving(model: jaxsim.Model) -> jaxsim.State:
    return jaxsim.make_state(model).replace(qvel=jnp.array([1.5, -2.0]))


def velocity(mj: mujoco.MjModel) -> np.ndarray:
    """MuJoCo's velocity after a step from the moving state."""
    data = mujoco.MjData(mj)
    data.qvel[:] = [1.5, -2.0]
    mujoco.mj_step(mj, data)
    return data.qvel


def test_all_are_covered():
    assert set(VALUES) == set(OPTIONAL_FORCES)


@pytest.mark.parametrize(
    "integrator", ["Euler", pytest.param("implicitfast", marks=pytest.mark.slow)]
)
def test_each_takes_effect_and_has_a_derivative(integrator, x64):
    """Value against MuJoCo, derivative along the change against central differences."""
    # MuJoCo looks at some of them only where they were there when it compiled.
    text = XML.format(integrator=integrator).replace("<body ", '<body gravcomp="1" ')
    text = text.replace("<motor ", '<motor damping="1" ').replace("<worldbody>", FLOOR)
    mj = mujoco.MjModel.from_xml_string(
        text.replace("<geom ", '<geom surfacevel="1 0 0" adhesion="1" ')
    )
    mj.body_gravcomp[:], mj.actuator_damping[:], mj.opt.tolerance = 0, 0, 0
    mj.geom_surfacevel[:], mj.geom_adhesion[:], mj.pair_adhesion[:] = 0, 0, 0
    model, plain = jaxsim.load(mj), velocity(mj)
    for name, numbers in VALUES.items():
        value = jnp.asarray(numbers, float)

        def step(t, name=name, value=value):
            return jaxsim.step(put(model, name, t * value), moving(model)).qvel

        found, slope = quick_jit(lambda t, step=step: jax.jvp(step, (t,), (1.0,)))(1.0)
        target = mj.opt if "." in name else mj
        field = name.rpartition(".")[2]
        before = np.array(getattr(target, field))
        oracle = []
        for t in (1.0, 1.0 + 1e-5, 1.0 - 1e-5):
            if before.ndim:
                getattr(target, field)[...] = t * np.reshape(numbers, before.shape)
            else:
                setattr(target, field, t * numbers)
            oracle.append(velocity(mj))
        if before.ndim:
            getattr(target, field)[...] = before
        else:
            setattr(target, field, float(before))
        assert np.abs(oracle[0] - plain).max() > 1e-5, name
        np.testing.assert_allclose(found, oracle[0], atol=1e-8, err_msg=name)
        difference = (oracle[1] - oracle[2]) / 2e-5
        np.testing.assert_allclose(slope, difference, atol=1e-6, rtol=1e-5, err_msg=name)


def test_what_stays_zero_costs_nothing():
    model = jaxsim.load(XML.format(integrator="Euler"))
    assert model.present == ((),) * len(OPTIONAL_FORCES)
    assert model.replace(body_mass=2 * model.body_mass).present == model.present
    assert put(model, "dof_frictionloss", jnp.zeros(2)).present == model.present
    some = put(model, "dof_frictionloss", jnp.array([0.0, 1.0]))
    assert some.nonzero_rows("dof_frictionloss") == (1,)
    # It may come back, so its rows stay; no program is compiled anew for it.
    assert put(some, "dof_frictionloss", jnp.zeros(2)).present == some.present


def test_a_batch_of_models_and_its_axes_fit_together():
    model = jaxsim.load(XML.format(integrator="Euler"))
    loss = jnp.array([[0.0, 0.0], [1.0, 0.0]])
    batch = put(model, "dof_frictionloss", loss)
    axes = put(jax.tree.map(lambda _: None, model), "dof_frictionloss", 0)
    step = jax.vmap(lambda m, s: jaxsim.step(m, s).qvel, in_axes=(axes, None))
    found = quick_jit(step)(batch, moving(model))
    assert abs(found[0, 0] - found[1, 0]) > 1e-4
    for row in range(2):
        alone = quick_jit(jaxsim.step)(put(model, "dof_frictionloss", loss[row]), moving(model))
        np.testing.assert_allclose(found[row], alone.qvel, rtol=1e-5)
