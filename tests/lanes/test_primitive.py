"""A kernel among JAX's transformations: what it means is what its function means."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export, lax
from oracle import quick_jit

import jaxsim
from jaxsim.arrays import tuning
from jaxsim.batching import jaxprs
from jaxsim.batching.primitives.decisions import any_in_batch
from jaxsim.lanes import as_kernel, compiler, primitive, switch

RNG = np.random.default_rng(2)
X = jnp.asarray(RNG.normal(size=(37, 3)), jnp.float32)


def f(x):
    """A loop that lanes leave at different times, a branch, and an index known at run time."""
    y, count = lax.while_loop(lambda c: c[0] @ c[0] < 9, lambda c: (c[0] * 1.5, c[1] + 1), (x, 0))
    z = lax.cond(x[0] > 0, lambda: jnp.linalg.solve(jnp.eye(3) + jnp.outer(x, x), y), lambda: -y)
    return {"z": z, "at": x[count % 3], "same": x, "constant": jnp.float32(2)}


def g(x):
    return jnp.sin(x) * (x @ jnp.outer(x, x)) + lax.fori_loop(0, 3, lambda i, y: y * 0.5 + x[i], x)


def assert_same(found, expected):
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(a, b, rtol=2e-5, atol=1e-6)


@pytest.mark.parametrize("batch", [1, 5, 37])
@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
def test_batches(batch, vmap):
    """Shorter than a group, and no multiple of one."""
    found = quick_jit(vmap(as_kernel(f)))(X[:batch])
    assert_same(found, jax.vmap(f)(X[:batch]))


def test_one_call_in_the_program():
    traced = jax.make_jaxpr(jaxsim.vmap(as_kernel(f)))(X)
    assert [e.primitive.name for e in traced.eqns].count("lane_batch") == 1
    text = jax.jit(jaxsim.vmap(as_kernel(f))).lower(X).as_text()
    assert text.count("jaxsim_lanes_") == 1


def test_alone_nested_and_in_loops():
    def steps(x):
        return lax.scan(lambda x, _: (as_kernel(g)(0.3 * x), x), x, None, 4)

    def plain(x):
        return lax.scan(lambda x, _: (g(0.3 * x), x), x, None, 4)

    assert_same(quick_jit(as_kernel(f))(X[0]), f(X[0]))
    assert_same(quick_jit(jaxsim.vmap(steps))(X), jax.vmap(plain)(X))
    noise = lambda x: g(x) + jax.random.normal(jax.random.key(1), (3,))  # noqa: E731
    assert_same(quick_jit(as_kernel(noise))(X[0]), noise(X[0]))
    inside = as_kernel(lambda x: 2 * as_kernel(g)(x))
    assert_same(quick_jit(inside)(X[0]), 2 * g(X[0]))
    pairs = X[:36].reshape(6, 6, 3)
    scaled = lambda x, s: g(x) * s  # noqa: E731
    nested = jax.vmap(jax.vmap(as_kernel(scaled), (0, None)), (0, 0))
    plainly = jax.vmap(jax.vmap(scaled, (0, None)), (0, 0))
    assert_same(quick_jit(nested)(pairs, pairs[0, :, 0]), plainly(pairs, pairs[0, :, 0]))


def test_derivatives():
    def loss(f):
        return lambda x: jnp.sum(jax.vmap(f)(x) ** 2)

    assert_same(quick_jit(jax.grad(loss(as_kernel(g))))(X), jax.grad(loss(g))(X))
    inside = jax.vmap(jax.jacfwd(as_kernel(g)))
    assert_same(quick_jit(inside)(X), jax.vmap(jax.jacfwd(g))(X))
    # What is differentiated first is one kernel as well.
    outside = jax.vmap(as_kernel(jax.grad(lambda x: g(x).sum())))
    assert_same(quick_jit(outside)(X), jax.vmap(jax.grad(lambda x: g(x).sum()))(X))


@pytest.mark.parametrize("f", [jax.vmap(as_kernel(g)), lambda x: as_kernel(g)(x[0])])
def test_exported_programs_hold_no_machine_code(f):
    exported = export.export(jax.jit(f))(X)
    assert "jaxsim_lanes_" not in exported.mlir_module()
    assert_same(exported.call(X), f(X))


def test_nan_in_nan_out():
    """A NaN reaches what it reaches under XLA, through products with zero as well, and no more."""

    def h(x):
        return x * 0.0, x + 1, jnp.maximum(x, 0.0), jnp.minimum(0.0, x), jnp.sum(x), x > 0, x @ x

    x = X.at[3, 1].set(jnp.nan).at[7].set(jnp.inf)
    assert_same(quick_jit(jax.vmap(as_kernel(h)))(x), quick_jit(jax.vmap(h))(x))


def _operations(f, **options) -> str:
    kind = jax.ShapeDtypeStruct((), jnp.float32)
    return compiler.source(jax.make_jaxpr(f)(kind), (True,), single=True, **options)[0]


def test_finite_math():
    """Products with a known zero are zero where that is asked for, within other kernels as well."""
    vanishes = as_kernel(lambda x: (x * 0.0, x + 1), finite_math=True)
    found = quick_jit(lambda x: (*vanishes(x), x * 0.0))(jnp.float32(np.nan))
    np.testing.assert_array_equal(found, [0, np.nan, np.nan])
    outer = quick_jit(as_kernel(lambda x: (*vanishes(x), x * 0.0)))
    np.testing.assert_array_equal(outer(jnp.float32(np.nan)), [0, np.nan, np.nan])
    product = lambda x: jnp.sin(x) * 0 + x  # noqa: E731
    assert "call float @sin_f32" in _operations(product)
    assert "call float @sin_f32" not in _operations(product, finite_math=True)


def test_sums_at_places_known_at_run_time():
    """A product with a one-hot matrix, in a loop and outside, becomes additions in memory."""

    def sums(x):
        rank = jnp.cumsum(any_in_batch(x[:, 0] > 1.2))
        place = jax.vmap(lambda i: jnp.sum(rank <= i))(jnp.arange(3)) - 1
        ones = (place[:, None] == jnp.arange(4)[None]).astype(x.dtype)
        first = jnp.einsum("nl,n...->l...", ones, x[:3])
        loop = lambda c: (0.5 * c[0] + jnp.einsum("nk,nl->kl", x[:3] * c[0].sum(), ones), c[1] + 1)  # noqa: E731
        return first, lax.while_loop(lambda c: c[1] < 3 + x[0, 0], loop, (first, 0.0))[0]

    x = jnp.asarray(RNG.normal(size=(37, 5, 4)), jnp.float32)
    found = quick_jit(jaxsim.vmap(as_kernel(sums, finite_math=True)))(x)
    assert_same(found, quick_jit(jaxsim.vmap(sums))(x))
    kind = jax.ShapeDtypeStruct((5, 4), jnp.float32)
    traced = jax.make_jaxpr(sums)(kind)
    products = [
        compiler.source(traced, (True,), finite)[0].count(" fmul ") for finite in (False, True)
    ]
    assert products[0] > products[1] + 3 * 4 * 4


def test_small_powers_are_products():
    """As exponentials of logarithms, they have the same ends."""
    x = jnp.asarray([-np.inf, -2, -0.0, 0, 1e-3, 0.7, 30, np.inf, np.nan], jnp.float32)
    for n in (2, 3, 4, 2.5):

        def power(x, n=n):
            return jnp.exp(n * jnp.log(x))

        assert ("@log_f32" in _operations(power)) == (n == 2.5)
        found = quick_jit(jax.vmap(as_kernel(power)))(x)
        np.testing.assert_allclose(found, quick_jit(jax.vmap(power))(x), rtol=1e-5)


def test_what_is_unknown_stays_with_xla(monkeypatch):
    def fails(*args):
        raise NotImplementedError("this")

    monkeypatch.setattr(compiler, "kernel", fails)
    primitive._warn.cache_clear()
    with pytest.warns(UserWarning, match="leaves a program to XLA: it does not know this"):
        assert_same(quick_jit(jax.vmap(as_kernel(g)))(X), jax.vmap(g)(X))


def test_programs_that_would_overflow_the_stack_are_those_of_xla(monkeypatch):
    monkeypatch.setattr(compiler, "LARGEST_FRAME", 0)
    monkeypatch.setattr(compiler.cache, "load", lambda key: None)
    primitive._warn.cache_clear()
    f = lambda x: g(x) + 0.125  # noqa: E731 (a program that no other test has compiled)
    with pytest.warns(UserWarning, match="does not know programs that keep"):
        assert_same(quick_jit(jax.vmap(as_kernel(f)))(X), jax.vmap(f)(X))


def test_large_programs_are_those_of_xla(monkeypatch):
    traced = jax.make_jaxpr(g)(X[0])
    monkeypatch.setattr(tuning, "KERNEL_SCALARS", jaxprs.num_scalars(traced.eqns) - 1)
    assert "lane_batch" not in str(jax.make_jaxpr(jax.vmap(as_kernel(g)))(X))
    monkeypatch.setattr(tuning, "KERNEL_SCALARS", jaxprs.num_scalars(traced.eqns))
    assert "lane_batch" in str(jax.make_jaxpr(jax.vmap(as_kernel(g)))(X))


def test_equal_operations_are_made_once():
    """Out of the loop as well, where nothing in it changes them."""

    def h(x):
        return jnp.sin(x), lax.while_loop(lambda y: y < 9, lambda y: y + jnp.sin(x) ** 2, x)

    kind = jax.ShapeDtypeStruct((), jnp.float32)
    text, _ = compiler.source(jax.make_jaxpr(h)(kind), (True,), single=True)
    assert text.count("call float @sin_f32") == 1


def test_integers():
    """Division, shifts and bits, at the ends as well."""

    def h(a, b):
        bits = lax.population_count(a), lax.clz(a), a & b, a ^ b, ~a
        shifts = lax.shift_left(a, b), lax.shift_right_arithmetic(a, b)
        logical = lax.shift_right_logical(a, b)
        return *bits, *shifts, logical, lax.div(a, b), lax.rem(a, b), abs(a), jnp.sign(a)

    ends = np.iinfo(np.int32)
    a = jnp.asarray(np.array([0, 1, -1, 7, -7, ends.min, ends.max, 12345], np.int32))
    b = jnp.asarray(np.array([0, 31, -1, 2, 2, -1, 40, 5], np.int32))
    assert_same(quick_jit(jax.vmap(as_kernel(h)))(a, b), quick_jit(h)(a, b))


def test_loops_that_begin_with_what_is_known_outside():
    """An inner loop and a branch read values that were moved out of the loop around them."""

    def inner(x, limit):
        start = jnp.sin(x)
        y, _ = lax.while_loop(lambda c: c[1] < limit, lambda c: (c[0] * 0.9, c[1] + 1), (start, 0))
        return lax.cond(
            start[0] > 0.2, lambda: jnp.linalg.solve(jnp.eye(3) + jnp.outer(y, y), start), lambda: y
        )

    def h(x):
        wants = lambda c: c[1] < 2 + 3 * jnp.abs(x[1])  # noqa: E731
        return lax.while_loop(wants, lambda c: (c[0] + inner(x, c[1]), c[1] + 1), (x, 0))

    assert_same(quick_jit(jax.vmap(as_kernel(h)))(X), jax.vmap(h)(X))


def test_an_array_of_a_loop_that_begins_with_a_constant():
    """It is put together in the loop, whatever its first element is."""

    def h(x):
        def turn(c):
            y, i = c
            padded = jnp.concatenate([jnp.zeros(1), jnp.sin(y)])
            return y + padded[(i + (x[0] > 0)) % 4], i + 1

        return lax.while_loop(lambda c: c[1] < 2 + 3 * jnp.abs(x[1]), turn, (x, 0))

    assert_same(quick_jit(jax.vmap(as_kernel(h)))(X), jax.vmap(h)(X))


def test_unstack():
    """One equation in newer releases of JAX."""
    parts = lambda x: [2 * part for part in jnp.unstack(jnp.outer(x, x), axis=1)]  # noqa: E731
    assert_same(quick_jit(jax.vmap(as_kernel(parts)))(X), jax.vmap(parts)(X))


def test_on_by_default_on_a_gpu(monkeypatch):
    monkeypatch.setattr(switch, "_enabled", None)
    assert not switch.lanes_enabled()
    monkeypatch.setattr(jax, "default_backend", lambda: "gpu")
    assert switch.lanes_enabled() == switch.lanes_installed()
    switch.enable_lanes(False)
    assert not switch.lanes_enabled()


@pytest.mark.parametrize("double", [False, True])
def test_bits_of_numbers(x64, double):
    """As words and back, of numbers that are known and of ones that are not; NaN keeps its bits."""
    dtype = jnp.float64 if double else jnp.float32

    def words(x, n):
        parts = x, jnp.asarray([0.1, -2.5, jnp.inf], dtype), n.astype(jnp.int32)
        return [lax.bitcast_convert_type(part, jnp.uint32) for part in parts]

    def back(parts):
        x, known, n = parts
        assert lax.bitcast_convert_type(x[:0], dtype).shape == (0,)
        return [lax.bitcast_convert_type(p, dtype) for p in (x, known)], n + 1

    x = jnp.asarray(RNG.normal(size=(5, 3)), dtype).at[2, 1].set(jnp.nan)
    n = jnp.arange(-2, 3)
    made = quick_jit(jax.vmap(as_kernel(words)))(x, n)
    jax.tree.map(np.testing.assert_array_equal, made, jax.vmap(words)(x, n))
    jax.tree.map(
        np.testing.assert_array_equal,
        quick_jit(jax.vmap(as_kernel(back)))(made),
        jax.vmap(back)(made),
    )
