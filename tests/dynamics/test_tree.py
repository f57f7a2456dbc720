"""Walks over trees, and indexing with static indices."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

from jaxsim.arrays import tuning
from jaxsim.dynamics.tree import accumulate_inward, accumulate_outward, inward, outward
from jaxsim.model.topology import Forest


def _chain(n: int) -> list[int]:
    return [i - 1 for i in range(n)]


FORESTS = {
    "empty": [],
    "one node": [-1],
    "roots only": [-1, -1, -1],
    "short chain": _chain(5),
    "scanned chain": _chain(40),
    "long chain": _chain(512),
    "binary": [(i - 1) // 2 for i in range(31)],
    "star": [-1] + [0] * 60,
    "equal chains": [-1 if i % 20 == 0 else i - 1 for i in range(60)],
    "chain with a brush": _chain(20) + [19] * 3 + [20, 21, 22],
    "chains of two lengths": [*_chain(30), -1, *range(30, 45)],
    "branches that join a scan": [-1, 0, 0, *range(1, 40)],
    "numbered backwards": [1, 2, 3, -1],
}
# These have one kind of node only, so that their levels repeat.
SCANNED = ("scanned chain", "long chain", "equal chains", "chains of two lengths")


@pytest.fixture(params=FORESTS)
def forest(request) -> Forest:
    """Forests of every shape; kinds alternate by index and have 1 or 3 degrees of freedom."""
    parent = FORESTS[request.param]
    return Forest(parent, *_kinds(len(parent), 1 if request.param in SCANNED else 2))


def test_order_is_by_depth_and_parents_come_first(forest):
    assert sorted(forest.order) == list(range(len(forest)))
    assert (forest.parent < np.arange(len(forest))).all()
    assert sum(level.size for level in forest.levels) == len(forest)
    assert [run.start for run in forest.runs[1:]] == [run.stop for run in forest.runs[:-1]]


def test_outward_is_the_recurrence_from_the_roots(forest, rng):
    x, v, root = (
        rng.normal(size=len(forest)),
        rng.normal(size=forest.nv),
        rng.normal(size=forest.nroot),
    )
    y, z = quick_jit(lambda *a: outward(forest, _descend, *a))(root, x, v)
    expected, along = np.zeros(len(forest)), np.zeros(forest.nv)
    for i in range(len(forest)):
        above = root[forest.root[i]] if forest.parent[i] < 0 else expected[forest.parent[i]]
        expected[i], along[_dofs(forest, i)] = _descend(above, x[i], v[_dofs(forest, i)])
    np.testing.assert_allclose(y, expected, atol=1e-12)
    np.testing.assert_allclose(z, along, atol=1e-12)


def test_inward_is_the_recurrence_from_the_leaves(forest, rng):
    x, v = rng.normal(size=len(forest)), rng.normal(size=forest.nv)
    m, z = quick_jit(lambda *a: inward(forest, _descend, jnp.zeros(()), *a))(x, v)
    total, expected, along = np.zeros(len(forest)), np.zeros(len(forest)), np.zeros(forest.nv)
    for i in reversed(range(len(forest))):
        expected[i], along[_dofs(forest, i)] = _descend(total[i], x[i], v[_dofs(forest, i)])
        if forest.parent[i] >= 0:
            total[forest.parent[i]] += expected[i]
    np.testing.assert_allclose(m, expected, atol=1e-12)
    np.testing.assert_allclose(z, along, atol=1e-12)


def test_sums_outward_and_inward_are_adjoint(forest, rng):
    x, y = rng.normal(size=(2, len(forest)))
    down, up = accumulate_outward(forest, jnp.asarray(x)), accumulate_inward(forest, jnp.asarray(y))
    np.testing.assert_allclose(down @ y, x @ up, atol=1e-9)
    np.testing.assert_allclose(down, forest.ancestor @ x, atol=1e-9)


def test_running_sums_are_those_of_the_ancestors(forest, rng):
    x = rng.normal(size=(len(forest), 2))
    down = accumulate_outward(forest, jnp.asarray(x))
    for node, parent in enumerate(forest.parent):
        above = down[parent] if parent >= 0 else 0
        np.testing.assert_allclose(down[node], above + x[node], atol=1e-9)


def test_moves_marks_the_degrees_of_freedom_between_a_node_and_its_root(forest):
    assert forest.moves.shape == (len(forest) + 1, forest.nv)
    assert not forest.moves[-1].any()
    for k, node in enumerate(forest.dof_node):
        assert (forest.moves[:-1, k] == forest.ancestor[:, node]).all()


def test_long_chains_are_scanned_in_a_program_whose_size_does_not_grow():
    def size(n):
        chain = Forest(_chain(n))
        x = jnp.zeros(n)
        return len(jax.make_jaxpr(lambda x: accumulate_inward(chain, x))(x).eqns)

    assert size(512) == size(2 * tuning.SCANNED_LEVELS)
    assert [run.stop - run.start for run in Forest(_chain(40)).runs] == [40]


@pytest.mark.parametrize("name", ["binary", "scanned chain"])
def test_walks_have_derivatives_in_both_modes(name, rng):
    forest = Forest(FORESTS[name])
    x = jnp.asarray(rng.normal(size=len(forest)))

    def f(x):
        y, _ = outward(
            forest, lambda above, x, _: (jnp.sin(above) + x, ()), jnp.ones(forest.nroot), x
        )
        m, _ = inward(forest, lambda below, y, _: (below * jnp.cos(y) + y, ()), jnp.zeros(()), y)
        return m

    forward, reverse = quick_jit(jax.jacfwd(f))(x), quick_jit(jax.jacrev(f))(x)
    step = 1e-6
    direction = rng.normal(size=len(forest))
    difference = (f(x + step * direction) - f(x - step * direction)) / (2 * step)
    np.testing.assert_allclose(forward, reverse, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(forward @ direction, difference, rtol=1e-6, atol=1e-6)


def _kinds(n: int, count: int) -> tuple[np.ndarray, np.ndarray]:
    kind = np.arange(n) // 3 % count
    return kind, np.array([3, 1])[kind]


def _dofs(forest: Forest, i: int) -> slice:
    return slice(forest.dof_start[i], forest.dof_start[i] + forest.ndof[i])


def _descend(above, x, v):
    """A recurrence that is not commutative."""
    return 0.5 * above + x * v.sum(), v * above + x
