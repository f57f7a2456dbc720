"""What is not finite must be seen: one rule for all integrators, whatever the solver refuses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

import jaxsim

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
