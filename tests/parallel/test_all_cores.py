"""Models of each size class on several devices at once: what waits for threads never returns."""

import os
import subprocess
import sys

import pytest

# Independent pendulums at their limits: one matrix for the constraints, one for the integrator.
PENDULUMS = """
import jax, jax.numpy as jnp, numpy as np, mujoco, jaxsim
jaxsim.configure_cpu(2)
body = '<body><joint range="-1 1" damping="1"/><geom size=".1" pos=".2 0 0"/></body>'
mj = mujoco.MjModel.from_xml_string(
    '<mujoco><compiler angle="radian"/><default><geom contype="0" conaffinity="0"/></default>'
    f'<option integrator="{integrator}"/><worldbody>' + body * {dofs} + '</worldbody></mujoco>'
)
model = jaxsim.load(mj, hessian="dense")
batch, steps = 256, 20
angles = np.linspace(1.0, 1.1, batch)[:, None] * np.ones((1, model.nq))
state = jaxsim.make_state(model)
states = jax.vmap(lambda q: state.replace(qpos=q))(jnp.asarray(angles, state.qpos.dtype))
final = jaxsim.batch_rollout(model, states, jnp.zeros((batch, steps, 0)))
data = mujoco.MjData(mj)
data.qpos[:] = angles[-1]
mujoco.mj_step(mj, data, steps)
print(np.abs(final.qpos[-1] - data.qpos).max())
"""

BUNDLED = """
import jax, jax.numpy as jnp, numpy as np, jaxsim
jaxsim.configure_cpu(2)
model = jaxsim.load("{name}")
state = jaxsim.make_state(model)
batch, steps = 256, 20
states = jax.tree.map(lambda x: jnp.broadcast_to(x, (batch, *x.shape)), state)
final = jaxsim.batch_rollout(model, states, jnp.zeros((batch, steps, model.nu)))
print(float(not np.isfinite(final.qpos).all()))
"""


def run(code: str, seconds: float) -> float:
    """What a process of its own prints, which fails if it takes longer."""
    environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    environment |= {"JAX_PLATFORMS": "cpu"}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment,
        check=False, timeout=seconds,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return float(done.stdout)


@pytest.mark.parametrize(
    ("dofs", "integrator"),
    [
        (40, "implicit"),
        pytest.param(6, "implicit", marks=pytest.mark.slow),
        pytest.param(20, "implicit", marks=pytest.mark.slow),
        pytest.param(80, "implicitfast", marks=pytest.mark.slow),
    ],
)
def test_factors_of_every_size(dofs, integrator):
    """Agreement with MuJoCo after the steps, in the time that a slow machine would need."""
    code = PENDULUMS.format(dofs=dofs, integrator=integrator)
    assert run(code, seconds=300) < 1e-4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["box_on_plane", "humanoid", "spheres"])
def test_bundled_models(name):
    assert run(BUNDLED.format(name=name), seconds=600) == 0
