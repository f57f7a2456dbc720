"""What is not finite must be seen: one rule for all integrators, whatever the solver refuses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim
from jaxsim.lanes import switch

ARM = """<mujoco><option integrator="{}"/><worldbody><body>
  <joint name="j" axis="0 1 0" damping=".1" limited="true" range="-90 90"/>
  <geom size=".1" pos=".3 0 0" mass="1"/></body></worldbody>
  <actuator><motor joint="j"/></actuator></mujoco>"""


@pytest.mark.parametrize("integrator", ["Euler", "implicit", "implicitfast", "RK4"])
def test_controls_that_are_not_finite_show_in_the_state(integrator):
    model = jaxsim.load(ARM.format(integrator))
    ctrls = jnp.asarray([[0.5], [jnp.nan], [jnp.inf]])
    after = quick_jit(jax.vmap(lambda c: jaxsim.step(model, jaxsim.make_state(model), c)))(ctrls)
    np.testing.assert_array_equal(np.isfinite(after.qvel[:, 0]), [True, False, False])
    np.testing.assert_array_equal(np.isfinite(after.qpos[:, 0]), [True, False, False])
    jaxsim.check(jax.tree.map(lambda x: x[0], after))
    with pytest.raises(jaxsim.SimulationError, match="2 of 3 environments"):
        jaxsim.check(after)


@pytest.mark.parametrize("integrator", ["Euler", "RK4"])
def test_kernels_lose_nothing_that_is_not_finite(integrator, monkeypatch):
    """Where they take products with zero for zero: a force along the axis moves nothing."""
    monkeypatch.setattr(switch, "_enabled", True)
    model = jaxsim.load(ARM.format(integrator))
    fine = jaxsim.make_state(model)
    names = ("qpos", "qvel", "qfrc_applied", "xfrc_applied")
    states = [fine] + [
        fine.replace(**{name: getattr(fine, name).at[(-1,) * getattr(fine, name).ndim].set(bad)})
        for name, bad in zip(names, (np.nan, np.inf, -np.inf, np.nan), strict=True)
    ]
    states += [fine.replace(xfrc_applied=fine.xfrc_applied.at[1, 1].set(np.nan))]
    batch = jax.tree.map(lambda *x: jnp.stack(x), *states)
    step = jax.vmap(lambda s: jaxsim.step_with_status(model, s, jnp.zeros(1)))
    assert "lane_batch" in str(jax.make_jaxpr(step)(batch))
    after, status = quick_jit(step)(batch)
    np.testing.assert_array_equal(np.isfinite(after.qpos[:, 0]), [True] + 5 * [False])
    np.testing.assert_array_equal(np.isfinite(after.qvel[:, 0]), [True] + 5 * [False])
    np.testing.assert_array_equal(status.finite, [True] + 5 * [False])
