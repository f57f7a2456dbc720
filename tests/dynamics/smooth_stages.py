"""One instant and one step of the smooth dynamics, ours and MuJoCo's, constraints switched off."""

import jax
import mujoco
import numpy as np
from oracle import assert_close, quick_jit, stack
from random_models import random_states

from jaxsim import engine
from jaxsim.engine.instant import Instant
from jaxsim.engine.stepping import evaluate
from jaxsim.io import load
from jaxsim.model import make_state

FORCES = ((1e-10, 1e-10), (1e-3, 1e-4))
LENGTHS = ((1e-12, 1e-12), (1e-5, 1e-4))
STEPS = ((1e-8, 1e-8), (1e-4, 1e-4))
# Absolute and relative tolerances in float64 and float32.
INSTANT = {
    "qfrc_spring": FORCES,
    "qfrc_damper": FORCES,
    "qfrc_gravcomp": FORCES,
    "qfrc_fluid": FORCES,
    "qfrc_passive": FORCES,
    "actuator_length": LENGTHS,
    "actuator_velocity": FORCES,
    "actuator_force": FORCES,
    "qfrc_actuator": FORCES,
    "act_dot": FORCES,
    "qacc_smooth": ((1e-9, 1e-9), (1e-2, 1e-3)),
}
NEXT = {"qpos": STEPS, "qvel": STEPS, "act": STEPS}


def compare(mj: mujoco.MjModel, precision: int = 0, n: int = 4, step: bool = True) -> None:
    """Check all stages and one step at random states; the first one is at rest."""
    mj.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    inputs = random_inputs(mj, n)
    theirs = stack([oracle(mj, *(x[k] for x in inputs)) for k in range(n)])
    ours = quick_jit(jax.vmap(smooth_step, in_axes=(None, 0, 0, 0, 0)))(load(mj), *inputs)
    tolerances = INSTANT | ({f"next_{k}": v for k, v in NEXT.items()} if step else {})
    for name, tolerance in tolerances.items():
        assert_close(ours[name], theirs[name], *tolerance[precision], name)


def random_inputs(mj: mujoco.MjModel, n: int) -> tuple[np.ndarray, ...]:
    """Stacked qpos, qvel, act and ctrl; some controls and activations are out of range."""
    rng = np.random.default_rng(3)
    qpos, qvel = random_states(mj, seed=0, n=n)
    qvel[0] = 0
    return qpos, 4 * qvel, rng.uniform(-0.2, 1.2, (n, mj.na)), 2 * rng.standard_normal((n, mj.nu))


def oracle(mj: mujoco.MjModel, qpos, qvel, act, ctrl) -> dict[str, np.ndarray]:
    """What MuJoCo says."""
    data = mujoco.MjData(mj)
    data.qpos[:], data.qvel[:], data.act[:], data.ctrl[:] = qpos, qvel, act, ctrl
    mujoco.mj_forward(mj, data)
    stages = {name: np.array(getattr(data, name)) for name in INSTANT}
    mujoco.mj_step(mj, data)
    return stages | {f"next_{name}": np.array(getattr(data, name)) for name in NEXT}


def smooth_step(model, qpos, qvel, act, ctrl) -> dict:
    """What we say."""
    state = make_state(model).replace(qpos=qpos, qvel=qvel, act=act)
    now, after = smooth(model, state, ctrl), step(model, state, ctrl)
    values = {name: getattr(now.passive, name) for name in INSTANT if hasattr(now.passive, name)}
    values |= {
        name: getattr(now.actuation, name)
        for name in INSTANT
        if name not in values and name != "qacc_smooth"
    }
    values |= {f"next_{name}": getattr(after, name) for name in NEXT}
    return values | {"qacc_smooth": now.qacc}


def smooth(model, state, ctrl) -> Instant:
    """What is known of a state without constraints."""
    return evaluate(_unconstrained(model), state, ctrl)


def step(model, state, ctrl):
    """The next state without constraints."""
    return engine.step(_unconstrained(model), state, ctrl)


def _unconstrained(model):
    flags = model.opt.disableflags | int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)
    return model.replace(opt=model.opt.replace(disableflags=flags))
