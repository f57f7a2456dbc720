"""Random programs as one kernel mean what they mean under `jax.vmap`."""

import jax
import numpy as np
import pytest
from vmap_compare import compiled
from vmap_programs import OPERATIONS, arguments, random_program

from jaxsim.lanes import as_kernel

pytestmark = pytest.mark.usefixtures("x64")


def assert_same(f, args, axes):
    found = compiled(jax.vmap(as_kernel(f), axes), *args)
    expected = compiled(jax.vmap(f, axes), *args)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("group", range(4))
def test_operations_one_by_one(group):
    """Every operation of the pool, on operands of each lane and on shared ones."""
    chosen = OPERATIONS[group::4]
    (s, v, m, i), _ = arguments(2 * group, 11)

    def f(s, v, m, i):
        pools = {"s": (s, m[0, 0]), "v": (v, m[1]), "m": (m, m.T), "i": (i, i + 1)}
        return [g(*[pools[kind][n % 2] for n, kind in enumerate(kinds)]) for _, kinds, g in chosen]

    assert_same(f, (s, v, m[0], i), (0, 0, None, 0))


@pytest.mark.parametrize("seed", range(4))
def test_program(seed):
    program = random_program(seed, length=8 + seed % 5)
    args, axes = arguments(seed, 5 + 6 * (seed % 2))
    assert_same(program, args, axes)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4, 204))
def test_many_programs(seed):
    program = random_program(seed, length=8 + seed % 5)
    args, axes = arguments(seed, 11)
    assert_same(program, args, axes)
