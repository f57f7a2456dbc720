"""Selection against sorting: random masks and numbers, none, all, ties and too many."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxsim
from jaxsim.collision.selection import for_each_set, set_indices, within_reach

# Around the length of a word, of many words, and not a power of two.
SIZES = [(2, 1), (31, 4), (32, 31), (33, 32), (65, 64), (300, 7), (2560, 80)]


@pytest.mark.parametrize("n", [1, 31, 32])
def test_each_set_index_is_visited_in_order(n, rng):
    masks = np.stack([rng.random(n) < share for share in (0, 0.2, 0.5, 1)])
    hashed = jax.vmap(lambda m: for_each_set(m, lambda k, x: (3 * x + k) % 1009, jnp.int32(1)))
    expected = []
    for mask in masks:
        x = 1
        for k in np.flatnonzero(mask):
            x = (3 * x + int(k)) % 1009
        expected.append(x)
    assert jax.jit(hashed)(masks).tolist() == expected


@pytest.mark.parametrize(("n", "count"), SIZES)
@pytest.mark.parametrize("share", [0.0, 0.02, 0.5, 1.0])
def test_indices_are_those_of_the_mask(n, count, share, rng):
    mask = rng.random(n) < share
    indices = np.asarray(jax.jit(set_indices, static_argnums=1)(mask, count))
    expected = np.nonzero(mask)[0][:count]
    np.testing.assert_array_equal(indices[: len(expected)], expected)
    assert not mask[indices[len(expected) :]].any()


@pytest.mark.parametrize(("n", "count"), SIZES)
def test_the_lowest_within_reach_are_chosen_and_the_others_counted(n, count, rng):
    """From none within reach to all, in a batch of which only some have too many."""
    excess = rng.standard_normal((20, n)) + np.linspace(-4, 4, 20)[:, None]
    chosen, lost = map(np.asarray, jax.jit(jax.vmap(lambda x: within_reach(x, count)))(excess))
    for x, indices, left_out in zip(excess, chosen, lost, strict=True):
        expected = np.sort(np.argsort(x)[: min(count, (x < 0).sum())])
        np.testing.assert_array_equal(indices[: len(expected)], expected)
        assert (x[indices[len(expected) :]] >= 0).all()
        assert left_out == (x < 0).sum() - len(expected)
    assert (lost > 0).any()
    assert (lost == 0).any()


def test_batch_minor_selection_is_the_same(rng):
    excess = rng.standard_normal((32, 70)).astype(np.float32)
    select = lambda x: within_reach(x, 33)  # noqa: E731
    fast, plain = (jax.jit(v(select))(excess) for v in (jaxsim.vmap, jax.vmap))
    for a, b in zip(fast, plain, strict=True):
        np.testing.assert_array_equal(a, b)


def test_the_first_of_equals_are_chosen():
    excess = jnp.asarray([-1.0, 2.0, -1.0, -3.0, 1.0, -1.0])
    chosen, lost = within_reach(excess, 3)
    assert (chosen.tolist(), int(lost)) == ([0, 2, 3], 1)
    chosen, lost = within_reach(jnp.full(9, -0.2), 4)
    assert (chosen.tolist(), int(lost)) == ([0, 1, 2, 3], 5)


def test_not_a_number_is_not_lost():
    excess = jnp.asarray([1.0, jnp.nan, -1.0, 2.0, jnp.inf, -jnp.inf])
    chosen, lost = within_reach(excess, 4)
    assert (chosen.tolist()[:3], int(lost)) == ([1, 2, 5], 0)
    crowd = jnp.full(5, jnp.nan)
    chosen, lost = within_reach(crowd, 2)
    assert (chosen.tolist(), int(lost)) == ([0, 1], 3)
