"""PID controllers, MuJoCo's plugin, move bodies as MuJoCo's do."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

# Numbers of the plugin, and attributes of the actuator.
CONTROLLERS = (
    ({"kp": 4}, 'ctrlrange="-.3 .3"'),
    ({"kp": 4, "kd": 0.4}, 'gear="2"'),
    ({"kp": 4, "kd": 0.4, "ki": 30}, 'actdim="1" forcerange="-1 1.5"'),
    ({"kp": 4, "kd": 0.4, "ki": 30, "imax": 0.02}, 'actdim="1"'),
    ({"kp": 4, "ki": -30, "imax": -0.02}, 'actdim="1"'),
    ({"kp": 4, "slewmax": 3}, 'actdim="1"'),
    ({"kp": 4, "kd": 0.1, "ki": 30, "imax": 0.05, "slewmax": 3}, 'actdim="2"'),
    ({"kp": 4, "kd": 0.1, "ki": 30}, 'actdim="2" dyntype="filter" dynprm=".05"'),
    ({"kp": 4, "kd": 0.1, "slewmax": 0.5}, 'actdim="2" dyntype="integrator" actearly="true"'),
    (
        {"kp": 4, "kd": 0.1, "ki": 30, "imax": 0.3, "slewmax": 2},
        'actdim="3" dyntype="filterexact" dynprm=".03" actearly="true"',
    ),
    ({"kp": 4, "kd": 0.1, "ki": 30}, 'actdim="2" dyntype="filter" actrange="-.01 .01"'),
    ({"kp": 4, "ki": 3}, 'actdim="1" group="3"'),
    ({"kp": 4, "kd": 0.1}, 'class="servo"'),
)


def mjcf(controllers=CONTROLLERS, options: str = "") -> str:
    """A slider for each controller, and two other actuators."""
    bodies = "".join(
        f'<body pos="{k} 0 0"><joint name="j{k}" type="slide" axis="0 0 1" damping=".05"/>'
        '<geom size=".1" mass=".1"/></body>'
        for k in range(len(controllers))
    )
    actuators = "".join(
        f'<plugin name="a{k}" joint="j{k}" plugin="mujoco.pid" {attributes}>'
        + "".join(f'<config key="{key}" value="{value}"/>' for key, value in numbers.items())
        + "</plugin>"
        for k, (numbers, attributes) in enumerate(controllers)
    )
    return f"""<mujoco><extension><plugin plugin="mujoco.pid"/></extension>
      <default><default class="servo"><position kp="5" kv=".3"/></default></default>
      <option timestep=".005" {options}/><worldbody>{bodies}</worldbody>
      <actuator>{actuators}<motor joint="j0" gear=".1"/>
      <general joint="j1" gear=".1" dyntype="filter" dynprm=".1"/></actuator></mujoco>"""


@pytest.mark.parametrize(
    ("options", "flags"),
    [
        ("", 0),
        ('integrator="RK4"', 0),
        ('integrator="implicitfast"', 0),
        ('actuatorgroupdisable="3"', mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL),
    ],
)
def test_rollout_agrees_with_mujoco(options, flags, rng, x64):
    """MuJoCo runs controllers of disabled groups, too, and always clamps their controls."""
    mj = mujoco.MjModel.from_xml_string(mjcf(options=options))
    mj.opt.disableflags |= int(flags)
    data, model = mujoco.MjData(mj), jaxsim.load(mj)
    qpos, qvel = 0.1 * rng.normal(size=mj.nq), rng.normal(size=mj.nv)
    data.qpos[:], data.qvel[:] = qpos, qvel
    state = jaxsim.make_state(model).replace(qpos=jnp.array(qpos), qvel=jnp.array(qvel))
    ctrls = rng.normal(size=(6, mj.nu)).repeat(10, axis=0)

    def body(state, ctrl):
        now = jaxsim.forward(model, state, ctrl)
        after = jaxsim.step(model, state, ctrl)
        return after, (now.qacc, now.act_dot, now.actuator_force, after.act, after.qvel)

    found = quick_jit(lambda s, u: jax.lax.scan(body, s, u)[1])(state, jnp.array(ctrls))
    for row, ctrl in zip(zip(*map(np.asarray, found), strict=True), ctrls, strict=True):
        data.ctrl[:] = ctrl
        mujoco.mj_forward(mj, data)
        expected = [data.qacc.copy(), data.act_dot.copy(), data.actuator_force.copy()]
        mujoco.mj_step(mj, data)
        for ours, theirs in zip(row, (*expected, data.act, data.qvel), strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)
    assert np.abs(data.act).max() > 0.01


def test_derivatives_by_gains_and_controls(rng, x64):
    """Of a short rollout, against differences; a gain of zero is no special case."""
    model = jaxsim.load(mjcf())
    start = jaxsim.make_state(model).replace(qvel=jnp.array(rng.normal(size=model.nv)))
    ctrl, weights = (jnp.array(rng.normal(size=n)) for n in (model.nu, model.nv))

    def loss(gains, ctrl):
        changed = model.replace(actuator_pid=gains)

        def step(state, _):
            return jaxsim.step(changed, state, ctrl), None

        return weights @ jax.lax.scan(step, start, None, 5)[0].qvel

    gains = model.actuator_pid
    assert gains.shape == (model.nactuator, 5)
    both = quick_jit(jax.value_and_grad(loss, (0, 1)))
    slopes = both(gains, ctrl)[1]
    for k, way in enumerate((jnp.array(rng.normal(size=gains.shape)), jnp.ones(model.nu))):
        ends = []
        for h in (1e-5, -1e-5):
            moved = [gains, ctrl]
            moved[k] = moved[k] + h * way
            ends.append(both(*moved)[0])
        np.testing.assert_allclose(jnp.vdot(slopes[k], way), (ends[0] - ends[1]) / 2e-5, rtol=1e-6)
        assert np.abs(slopes[k]).max() > 1e-3
    assert np.isfinite(both(0 * gains, ctrl)[1][0]).all()


@pytest.mark.parametrize(
    ("before", "attributes", "reason"),
    [
        ("", 'dyntype="muscle"', "may have dyntype none, integrator, filter or filterexact"),
        ("", 'nsample="3" delay=".01"', "ignores the delay"),
        ("", 'class="affine"', "takes no gain or bias from a default"),
        (
            '<dcmotor joint="j0" motorconst="1" resistance="1" input="none"/>',
            "",
            "have one control",
        ),
    ],
)
def test_what_mujoco_misreads_is_refused(before, attributes, reason):
    defaults = '<default class="affine"><general gaintype="affine" gainprm="1 1"/></default>'
    xml = mjcf([({"ki": 1}, f'actdim="1" {attributes}'), ({}, "")])
    xml = xml.replace("<actuator>", f"<actuator>{before}")
    with pytest.raises(jaxsim.ModelError, match=f"actuator 'a0'.*: .*{reason}"):
        jaxsim.load(xml.replace("<default>", f"<default>{defaults}", 1))


def test_changed_gains_cannot_be_exported():
    model = jaxsim.load(mjcf())
    assert jaxsim.to_mujoco(model).nu == model.nu
    with pytest.raises(jaxsim.ModelError, match="actuator 'a0': its actuator_pid has changed"):
        jaxsim.to_mujoco(model.replace(actuator_pid=2 * model.actuator_pid))
