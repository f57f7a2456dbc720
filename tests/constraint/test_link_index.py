"""Sums over the rows of a link: the same whether links are static or decided at run time."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.constraint.link_index import LinkIndex, add_at

ROUNDING = 1e-5  # of float32, over 40 rows whose sums come to about 10


@pytest.mark.parametrize(
    "links",
    [
        [0],
        [5],
        [1, 2],
        [2, 2, -1, 2],
        [5, 0, 5, 3],
        [0, 1, 2, 3, 4, 5],
        [-1, -1],
        [],
        [3, -1, 4] * 40,
    ],
    ids=lambda links: str(links[:6]),
)
def test_rows_are_added_at_their_links(links):
    rng = np.random.default_rng(0)
    total = jnp.asarray(rng.normal(size=(6, 3)), jnp.float32)
    x = jnp.asarray(rng.normal(size=(len(links), 2)), jnp.float32)
    form = lambda row: jnp.concatenate([row, row[:1] - row[1:]])  # noqa: E731
    expected = np.array(total)
    for link, row in zip(links, x, strict=True):
        if link >= 0:
            expected[link] += form(row)
    index = np.array(links, int)
    for kind in (LinkIndex.of(index), LinkIndex.of(jnp.asarray(index))):
        found, derivative = jax.jvp(lambda x, kind=kind: add_at(total, kind, x, form), (x,), (x,))
        np.testing.assert_allclose(found, expected, atol=ROUNDING)
        np.testing.assert_allclose(derivative, expected - total, atol=ROUNDING)
