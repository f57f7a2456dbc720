"""Of several starts the cheapest plan is returned, watched or not."""

import jax
import jax.numpy as jnp
import numpy as np
import optax
import pytest

from jaxsim import trajopt

# Two valleys, of which the one at x > 0 is deeper.
TWO_VALLEYS = trajopt.make_problem(
    lambda x, u: x + u,
    jnp.zeros(1),
    horizon=1,
    running_cost=lambda x, u, t: 0.0,
    final_cost=lambda x: jnp.sum((x**2 - 1) ** 2 - 0.2 * x),
    nu=1,
)
# Random guesses with this key begin in the other valley.
KEY = jax.random.key(3)
DEEPEST = np.roots([4, 0, -4, -0.2]).real.max()


@pytest.mark.parametrize("progress", [False, True])
def test_the_cheapest_plan(progress, capsys):
    method = trajopt.Shooting(optax.sgd(0.05), iterations=60, tolerance=1e-4)
    one, several = (
        trajopt.solve(TWO_VALLEYS, method, key=KEY, starts=n, progress=progress) for n in (1, 8)
    )
    assert one.states[-1, 0] < 0, "the example needs several starts"
    np.testing.assert_allclose(several.states[-1, 0], DEEPEST, atol=1e-3)
    assert several.cost < one.cost
    assert several.status == trajopt.PlanStatus.CONVERGED
    made = int(several.iterations)
    np.testing.assert_array_equal(np.isnan(several.history), np.arange(60) >= made)
    assert several.history[made - 1] == several.cost
    assert ("iteration" in capsys.readouterr().err) == progress


def test_starts_are_counted_and_random():
    with pytest.raises(trajopt.ProblemError, match="starts must be at least 1, got 0"):
        trajopt.solve(TWO_VALLEYS, trajopt.ILQR(), starts=0)
    with pytest.raises(trajopt.ProblemError, match="either ctrls or starts"):
        trajopt.solve(TWO_VALLEYS, trajopt.ILQR(), jnp.zeros((1, 1)), starts=2)
