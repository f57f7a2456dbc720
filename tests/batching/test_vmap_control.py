"""Loops, branches, nested calls and rematerialisation."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from vmap_compare import assert_same

from jaxsim.arrays import tuning
from jaxsim.batching import forms, registry, vmap

pytestmark = pytest.mark.usefixtures("x64")
RNG = np.random.default_rng(2)
X = RNG.normal(size=(5, 3))


def _program(f, *args, **axes):
    """Text of the traced program."""
    return str(jax.make_jaxpr(vmap(f, **axes))(*args))


def test_scan_carries_become_batched_in_turn():
    """A value that reaches the first carry through two others, over three iterations."""

    def f(x):
        def step(carry, _):
            a, b, c, shared = carry
            return (b, c, jnp.sum(x), shared + 1), a * shared

        return lax.scan(step, (0.0, 0.0, 0.0, 1.0), None, length=5)

    assert_same(f, X)


def test_scan_forms():
    """Scanned arrays per lane and shared ones, reversed, unrolled, of length zero."""

    def f(x, table):
        def step(carry, rows):
            return jnp.tanh(carry * rows[0] + rows[1]), {"out": carry, "shared": rows[1] * 2}

        start = x[0]
        return [
            lax.scan(step, start, (x, table)),
            lax.scan(step, start, (x, table), reverse=True, unroll=2),
            lax.scan(step, start, (x[:0], table[:0])),
        ]

    assert_same(f, X, jnp.arange(3.0), in_axes=(0, None))


def test_shared_counters_stay_shared():
    """So that indexing with them stays a slice."""

    def f(x):
        return lax.fori_loop(0, 3, lambda i, a: a + x[i] * jnp.arange(3.0)[i], 0.0)

    assert "gather" not in _program(f, X)
    assert_same(f, X)


def test_while_stops_lane_by_lane():
    """A lane that has finished keeps its values; the others go on."""

    def f(x):
        def body(carry):
            n, y, limit = carry
            return n + 1, y * 2, limit

        return lax.while_loop(lambda c: c[1] < c[2], body, (0, jnp.abs(x[0]) + 0.1, 50.0))

    assert_same(f, X, derivatives=("jvp",))
    assert len({int(n) for n in vmap(f)(X)[0]}) > 1


def test_frozen_lanes_see_no_overflow():
    """Values that would become NaN after a lane has stopped do not."""

    def f(x):
        return lax.while_loop(lambda v: v < x, lambda v: v + 1 / (x - jnp.floor(v)), -x)

    assert_same(f, jnp.array([0.5, 3.5, 2.0]), derivatives=())


@pytest.fixture
def every_loop_narrows(monkeypatch):
    """Short loops over few lanes go on with an eighth of them, too."""
    monkeypatch.setattr(tuning, "COMPACTION_BODY", 0)
    monkeypatch.setattr(tuning, "COMPACTION_MIN", 1)


@pytest.mark.parametrize("late", [0, 1, 2, 5, 16])
def test_while_goes_on_with_the_lanes_that_are_left(every_loop_narrows, late):
    """None, one, an eighth, more than an eighth or all lanes take longer than the others."""

    def f(x, bound, table):
        def turn(state):
            count, x, words = state
            inner = lax.while_loop(lambda y: y < 3.0, lambda y: y + x + 0.1, x)
            return count + 1, x * 0.9 + table[0] * inner, words.at[count % 2].add(x)

        return lax.while_loop(lambda s: s[0] < bound, turn, (0, x, jnp.zeros(2)))

    bounds = np.full(16, 2)
    bounds[RNG.permutation(16)[:late]] = 2 + RNG.integers(1, 9, late)
    x = RNG.uniform(0, 1, 16)
    only = {"derivatives": ("jvp",)}
    assert_same(f, x, bounds, jnp.array([0.01, 5.0]), in_axes=(0, 0, None), **only)
    assert_same(lambda x, b: f(x, b, jnp.array([x, x])), x, bounds, **only)


def test_narrowed_loops_nest_and_have_tangents(every_loop_narrows):
    def f(x, bound):
        turn = lambda s: (s[0] + 1, jnp.sin(s[1]) + s[0])  # noqa: E731
        return lax.while_loop(lambda s: s[0] < bound, turn, (0, x))[1]

    x, bounds = RNG.uniform(0, 1, (4, 8)), RNG.integers(0, 9, (4, 8))
    assert_same(vmap(f), x, bounds, derivatives=("jvp",))
    assert_same(jax.vmap(f), x, bounds, derivatives=("jvp",))


def test_while_with_shared_condition():
    """Runs without a selection, and carries that depend on no lane stay shared."""

    def f(x):
        def body(carry):
            i, a, b, c = carry
            return i + 1, b, jnp.sin(x) + c, c * 2.0

        return lax.while_loop(lambda c: c[0] < 4, body, (0, x * 0, x, 1.0))

    assert "select_n" not in _program(f, X)
    assert_same(f, X, derivatives=("jvp",))


def test_while_whose_condition_closes_over_lanes():
    """Only the condition depends on the lane."""

    def f(x):
        return lax.while_loop(lambda i: i < x, lambda i: i + 1, 0)

    assert_same(f, jnp.array([3, 0, 5]), derivatives=())


def test_nested_loops():
    """A while loop in a scan in a fori loop."""

    def f(x):
        def inner(c, row):
            c = lax.while_loop(lambda c: jnp.sum(c**2) < 2.0, lambda c: 1.5 * c + 0.1, c)
            return c * 0.3, jnp.sum(c) * row

        return lax.fori_loop(0, 2, lambda i, c: lax.scan(inner, c, x + i)[0], x)

    assert_same(f, X, derivatives=("jvp",))


def test_branches():
    """Shared and different predicates, results that depend on no lane in one branch."""

    def f(x, p, i):
        return [
            lax.cond(p, lambda: (x, 1.0), lambda: (x * 2, 2.0)),
            lax.cond(x[0] > 0, lambda y: jnp.sin(y), lambda y: jnp.zeros(3), x),
            lax.switch(i, [lambda: x, lambda: jnp.ones(3), lambda: x @ x * x]),
            lax.switch(jnp.argmax(x) + i, [lambda: x, lambda: 2 * x, lambda: jnp.ones(3)]),
            lax.switch(i + 7, [lambda: x, lambda: -x]),
        ]

    for p in (True, False):
        assert_same(f, X, jnp.asarray(p), 1, in_axes=(0, None, None))
    assert_same(f, X, X[:, 1] > 0, jnp.arange(5), derivatives=("vjp",))


def test_shared_predicate_keeps_the_branch():
    """Only one side runs."""
    text = _program(lambda x, p: lax.cond(p, jnp.sin, jnp.cos, x), X, True, in_axes=(0, None))
    assert "cond" in text or "switch" in text or "branches" in text


@pytest.mark.parametrize("policy", [None, jax.checkpoint_policies.dots_saveable])
def test_rematerialisation_is_kept(policy):
    """`jax.checkpoint` survives, with its policy, differentiated outside or inside."""

    def layer(x, w):
        return jnp.sin(w @ jnp.sin(x))

    def f(x):
        w = jnp.outer(x, x)
        return jax.checkpoint(layer, policy=policy)(jax.checkpoint(layer, policy=policy)(x, w), w)

    assert_same(f, X)
    assert _program(f, X).count("prevent_cse") >= 2
    gradient = jax.make_jaxpr(lambda x: vmap(jax.grad(lambda x: jnp.sum(f(x))))(x))(X)
    assert "differentiated=True" in str(gradient)


def test_scan_over_checkpoint():
    """The usual long rollout."""

    def f(x):
        step = jax.checkpoint(lambda c, _: (jnp.tanh(c @ jnp.outer(x, x)), jnp.sum(c)))
        return lax.scan(step, x, None, length=4)

    assert_same(f, X)


def test_nested_jit():
    """Small functions are inlined, large ones stay functions."""

    @jax.jit
    def large(x, y):
        for k in range(20):
            x = jnp.sin(x) * y + k
        return x, y

    assert_same(lambda x: large(x, 2.0), X)
    assert_same(lambda x: large(x[0], x[1])[0] + large(x[1], x[0])[0], X)
    assert "name=large" in _program(lambda x: large(x, 2.0), X)
    assert "name=<lambda>" not in _program(lambda x: jax.jit(lambda x: x + 1)(x), X)


def test_differentiated_twice():
    """Forward over reverse and reverse over forward, through a loop."""

    def f(x):
        return jnp.sum(lax.scan(lambda c, r: (jnp.tanh(c * r + x[0]), c), x[1], x)[1])

    assert_same(jax.hessian(f), X, derivatives=())
    assert_same(jax.jacrev(jax.jacfwd(f)), X, derivatives=())


def test_linearize():
    """The linear program outside, and inside."""
    f = lambda x: jnp.tanh(jnp.outer(x, x) @ x)  # noqa: E731
    found = jax.linearize(vmap(f), X)[1](X)
    np.testing.assert_allclose(found, jax.linearize(jax.vmap(f), X)[1](X), rtol=1e-12)
    assert_same(lambda x: jax.linearize(f, x)[1](x), X)
    assert_same(lambda x: jax.linear_transpose(lambda y: jnp.outer(x, x) @ y, x)(x), X)


@pytest.mark.parametrize("check", [True, False])
def test_inside_shard_map(check):
    """Each device evaluates its share, loops, products and custom derivatives included."""
    mesh = jax.make_mesh((2,), ("d",), axis_types=(jax.sharding.AxisType.Auto,))
    spec = jax.sharding.PartitionSpec("d")
    shared = jax.sharding.PartitionSpec()

    def run(batch):
        def f(w, x):
            y = lax.fori_loop(0, 3, lambda _, c: jnp.tanh(w @ c) + x, x)
            return jax.nn.relu(y) @ y

        return jax.shard_map(
            batch(f, in_axes=(None, 0)), mesh=mesh, in_specs=(shared, spec), out_specs=spec,
            check_vma=check,
        )  # fmt: skip

    w, x = jnp.asarray(RNG.normal(size=(3, 3))), X[:4]

    def both(batch):
        gradient = jax.grad(lambda w, x: jnp.sum(jnp.sin(run(batch)(w, x))), (0, 1))
        return jax.jit(lambda w, x: (run(batch)(w, x), gradient(w, x)))(w, x)

    for a, b in zip(jax.tree.leaves(both(vmap)), jax.tree.leaves(both(jax.vmap)), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-10)


def test_lanes_stay_last_inside_shard_map():
    """Shardings that JAX attaches there, and that divide nothing, are no reason to fall back."""
    mesh = jax.make_mesh((2,), ("d",), axis_types=(jax.sharding.AxisType.Auto,))
    spec = jax.sharding.PartitionSpec("d")

    def f(x):
        return jnp.where(x[:, None] > 0, x[None], 0.0).reshape(-1)

    part = jax.shard_map(vmap(f), mesh=mesh, in_specs=spec, out_specs=spec, check_vma=False)
    # The lanes change places with the other axis at the start, and back at the end.
    assert str(jax.make_jaxpr(part)(X[:4])).count("transpose[") == 2
    np.testing.assert_array_equal(jax.jit(part)(X[:4]), jax.vmap(f)(X[:4]))


def test_branches_of_platforms():
    """Each is for lanes that are last, and is taken where it belongs."""

    def f(x):
        return lax.platform_dependent(x, cpu=lambda x: x @ x, default=lambda x: x[0])

    assert_same(f, X)
    assert "lane_contract" in _program(f, X)
    text = jax.jit(vmap(f)).trace(X).lower(lowering_platforms=("cuda",)).as_text()
    assert "multiply" not in text


@pytest.mark.parametrize("name", ["scan", "while", "cond", "jit", "remat2", "custom_jvp_call"])
def test_unknown_parameters_fall_back(name, monkeypatch):
    """With one warning, and the same results."""

    def reader(parameters):
        return parameters["of a future release"]

    def f(x):
        y = lax.while_loop(lambda c: jnp.sum(c**2) < 9, lambda c: 2 * c + 1, x)
        y = lax.cond(x[0] > 0, jnp.sin, jnp.cos, jax.nn.relu(y))
        y = jax.checkpoint(lambda x: jnp.sin(x) * 2)(jax.jit(jnp.tanh)(y))
        return lax.scan(lambda c, r: (c * r, c), 1.0, y)

    known = registry._PRIMITIVES
    monkeypatch.setitem(known, name, dataclasses.replace(known[name], read=reader))
    forms.warn_unknown.cache_clear()
    with pytest.warns(UserWarning, match=f"how this JAX release .* stores {name}") as caught:
        assert_same(f, X, derivatives=("jvp",))
    assert len(caught) == 1
    forms.warn_unknown.cache_clear()
