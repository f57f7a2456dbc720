"""A mass that slides on a plane, with closed forms for every law of contact."""

import jax
import jax.numpy as jnp
import numpy as np
from oracle import quick_jit

import jaxsim

TIMESTEP = 0.004
# Starts in touch; gravity and friction are leaves.
XML = f"""<mujoco><option timestep="{TIMESTEP}" gravity="0 0 -10"/><worldbody>
  <geom name="floor" type="plane" size="0 0 1" friction=".5"/>
  <body pos="0 0 .1"><joint name="x" type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
    <geom name="mass" size=".1" mass="2" friction=".5"/></body></worldbody>
  <actuator><motor joint="x"/></actuator></mujoco>"""


def point_mass(contact: str, **options):
    """The model."""
    return jaxsim.load(XML, contact=contact, **options)


def compiled_step(model):
    """A compiled `step_with_status` of position, velocity and push; the model's leaves may vary."""

    def step(model, qpos, qvel, push):
        state = jaxsim.make_state(model).replace(qpos=qpos, qvel=qvel)
        return jaxsim.step_with_status(model, state, push)

    run = quick_jit(step)

    def call(qpos, qvel, push=0.0, model=model):
        kind = model.body_mass.dtype
        numbers = (jnp.asarray(x, kind) for x in (qpos, qvel, [push]))
        return run(model, *numbers)

    return call


def repeated(step, count: int, qpos, qvel, push=0.0, **options):
    """Positions, velocities and statuses after each of many steps."""
    found = []
    for _ in range(count):
        state, status = step(qpos, qvel, push, **options)
        qpos, qvel = state.qpos, state.qvel
        found.append((qpos, qvel, status))
    return jax.tree.map(lambda *xs: np.stack(xs), *found)
