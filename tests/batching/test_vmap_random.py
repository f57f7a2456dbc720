"""Random programs mean under `jaxsim.batching.vmap` what they mean under `jax.vmap`."""

import jax
import pytest
from vmap_compare import assert_equal, assert_same, compiled
from vmap_programs import OPERATIONS, arguments, derivative_modes, random_program

from jaxsim.batching import vmap

pytestmark = pytest.mark.usefixtures("x64")
GROUPS = 6


@pytest.mark.parametrize("group", range(GROUPS))
@pytest.mark.parametrize("modes", [("jvp", "vjp"), ("jvp",), ("vjp",)])
def test_operations_one_by_one(group, modes):
    """Every operation of the pool, on batched and on shared operands."""
    chosen = [o for o in OPERATIONS if derivative_modes([o[2]]) == modes][group::GROUPS]
    (s, v, m, i), _ = arguments(2 * group, 4)

    def f(s, v, m, i):
        pools = {"s": (s, m[0, 0]), "v": (v, m[1]), "m": (m, m.T), "i": (i, i + 1)}
        return [g(*[pools[kind][n % 2] for n, kind in enumerate(kinds)]) for _, kinds, g in chosen]

    assert_same(f, s, v, m[0], i, in_axes=(0, 0, None, 0), derivatives=modes)


@pytest.mark.parametrize("seed", range(6))
def test_program(seed):
    """Values and both derivatives, outside and inside."""
    _check_program(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6, 306))
def test_many_programs(seed):
    """The same for hundreds of programs."""
    _check_program(seed)


def _check_program(seed):
    program = random_program(seed, length=8 + seed % 5)
    args, axes = arguments(seed, 4)
    assert_same(program, *args, in_axes=axes, derivatives=program.modes, tolerance=1e-8)


@pytest.mark.parametrize("seed", [400])
@pytest.mark.parametrize("order", ["jax inside", "jax outside", "twice"])
def test_nested(seed, order):
    """Two batch axes, of either kind in either order."""
    program = random_program(seed, length=8)
    args, axes = arguments(0, 6)
    args = [a.reshape(2, 3, *a.shape[1:]) for a in args]
    inner, outer = {
        "jax inside": (jax.vmap, vmap),
        "jax outside": (vmap, jax.vmap),
        "twice": (vmap, vmap),
    }[order]
    found = compiled(outer(inner(program, axes), axes), *args)
    assert_equal(found, compiled(jax.vmap(jax.vmap(program, axes), axes), *args))
