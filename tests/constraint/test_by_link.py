"""Rows sorted by link are the same rows."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.constraint.jacobian import link_rows

TREE = """
<mujoco><worldbody>
  <body><freejoint/><geom size=".1"/>
    <body pos=".2 0 0"><joint axis="0 1 0"/><geom size=".1"/>
      <body pos=".2 0 0"><joint axis="0 1 0"/><geom size=".1"/></body></body>
    <body pos="-.2 0 0"><joint type="ball"/><geom size=".1"/></body>
  </body>
  <body pos="0 0 1"><joint/><geom size=".1"/></body>
</worldbody></mujoco>
"""


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("both", [False, True])
def test_the_same_products_as_unsorted_rows(seed, both):
    rng = np.random.default_rng(seed)
    tree = jaxsim.load(mujoco.MjModel.from_xml_string(TREE)).tree
    n, d, nlink = 11, 3, len(tree)
    link = rng.integers(-1, nlink, (2, n))
    if not both:
        link[0] = -1
    G = rng.standard_normal((2, n, d, 6))
    with jax.enable_x64(True):
        rows = link_rows(link[0], jnp.asarray(G[0]), link[1], jnp.asarray(G[1]))
        by_link = rows.sorted_by_link(tree)
        assert by_link.coupled == rows.coupled == both
        a, f = rng.standard_normal((nlink, 6)), rng.standard_normal((n, d))
        full = rng.standard_normal((n, d, d))
        close = lambda x, y: np.testing.assert_allclose(x, y, rtol=0, atol=1e-13)  # noqa: E731
        close(by_link.apply(None, a), rows.apply(None, jnp.asarray(a)))
        close(by_link.pull(tree, jnp.asarray(f))[1], rows.pull(tree, jnp.asarray(f))[1])
        for W in (jnp.asarray(f), jnp.asarray(full @ full.transpose(0, 2, 1))):
            close(by_link.curvature(tree, W)[1], rows.curvature(tree, W)[1])
