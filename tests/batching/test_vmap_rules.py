"""One test for each family of rules, against `jax.vmap`, with batched and shared operands."""

import itertools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax
from vmap_compare import assert_same

from jaxsim.batching import vmap

pytestmark = pytest.mark.usefixtures("x64")
RNG = np.random.default_rng(1)
BATCH = 4


def _normal(*shape):
    return jnp.asarray(RNG.normal(size=shape))


def _each_sharing(f, *args, derivatives=("jvp", "vjp"), thorough=False, **options):
    """f with every choice of batched operands; derivatives for all of them batched, or always."""
    for shared in itertools.product([False, True], repeat=len(args)):
        if not all(shared):
            given = [a[0] if s else a for a, s in zip(args, shared, strict=True)]
            modes = derivatives if thorough or not any(shared) else ()
            axes = [None if s else 0 for s in shared]
            assert_same(f, *given, in_axes=axes, derivatives=modes, **options)


def test_elementwise_with_scalars():
    """Operands of full shape, scalars per lane and shared scalars."""

    def f(s, x):
        return [
            s * x, x**3, jnp.clip(x, s, 2.0), jnp.clip(x, -1.0, 1.0),
            jnp.where(s > 0, x, s), jnp.where(x > 0, x, 2.0), jnp.where(s > 0, 1.0, x),
            lax.select(x > 0, x, x * s), jnp.arctan2(x, s), jnp.sign(x) % 2.0, jnp.hypot(x, s),
        ]  # fmt: skip

    _each_sharing(f, _normal(BATCH), _normal(BATCH, 2, 3))


def test_barrier_and_logical_reductions():
    """A barrier changes nothing; short and long reductions along any axes."""

    def f(x, y):
        both = lax.optimization_barrier((x, x * y))
        return [*both, *((x > k).any(k) for k in (0, 1)), (x > -2).all((0, 2)), (x > -3).all()]

    _each_sharing(f, _normal(BATCH, 3, 40, 5), _normal(BATCH, 3, 40, 5))
    empty = lambda x: [x.sum((0, 1)), (x > 0).any((0, 1)), x.sum()]  # noqa: E731
    assert_same(empty, _normal(BATCH, 3, 2, 0))


def test_clamp():
    """Bounds of each kind; the library has no derivative for those that are scalars."""

    def f(s, x):
        return [lax.clamp(-1.0, x, s), lax.clamp(x, x * s, x + 1), lax.clamp(s, x, 2.0)]

    _each_sharing(f, _normal(BATCH), _normal(BATCH, 2, 3), derivatives=())


def test_integers_and_bits():
    """Operations without derivative."""

    def f(i, j):
        return [
            i // (1 + j * j), i % 5, i & j, i | j, ~i, i << 2, lax.population_count(i),
            lax.bitcast_convert_type(i, jnp.float64), lax.bitcast_convert_type(i, jnp.int32),
            jnp.bitwise_count(i), i @ j, (i > 0) ^ (j > 0), jnp.any(i > j), jnp.all(i > j),
            jnp.argsort(i), jnp.argmin(i), lax.cummax(j), jnp.unique(i, size=2),
        ]  # fmt: skip

    i, j = (jnp.asarray(RNG.integers(-9, 9, size=(BATCH, 3))) for _ in range(2))
    _each_sharing(f, i, j, derivatives=())


def test_shapes():
    """Everything that moves entries without computing."""

    def f(x, y):
        return [
            x.T, x.reshape(3, 2), jnp.ravel(x), x[None], jnp.squeeze(x[:1]), x[::-1], x[:, ::2],
            jnp.concatenate([x, y]), jnp.stack([x, y], 1), jnp.split(x, [1], axis=1),
            jnp.pad(x, 1), lax.pad(x, y[0, 0], ((1, 0, 1), (0, -1, 0))),
            jnp.broadcast_to(x[0], (4, 3)), jnp.tile(y, 2), jnp.expand_dims(y, (0, 2)),
            jnp.moveaxis(jnp.zeros((2, 3, 4)) + x[..., None], 0, -1), jnp.repeat(x, 2, axis=0),
        ]  # fmt: skip

    _each_sharing(f, _normal(BATCH, 2, 3), _normal(BATCH, 2, 3))


def test_reductions():
    """Along one axis, several, all; cumulative ones and sorts."""

    def f(x):
        return [
            x.sum(0), x.sum((0, 2)), x.max(), x.min(1), x.prod(2), jnp.cumsum(x, 1),
            jnp.cumprod(x, 2), lax.cumlogsumexp(x, 0, reverse=True), jnp.sort(x, 1),
            lax.sort((x, x * 2), dimension=0, num_keys=2), jax.nn.softmax(x, 1), jnp.std(x),
            lax.top_k(x, 2)[0], jnp.median(x), jnp.linalg.norm(x), lax.reduce_precision(x, 8, 7),
            (x > 0).sum(1), (100 * x).astype(jnp.int32).sum((0, 2)),
            (100 * x * x).astype(jnp.uint8).sum(dtype=jnp.uint8),
        ]  # fmt: skip

    assert_same(f, _normal(BATCH, 2, 3, 2))


def test_extrema():
    """Equals share the derivative; a NaN wins; integers and truth values have no derivative."""

    def f(x):
        whole = (10 * x).astype(jnp.int32)
        return [
            x.max(), x.min(), x.max(0), x.min((0, 2)), jnp.abs(x).max((0, 2)),
            whole.max(0), whole.min(), (x > 0).max(), (x > 0).min(1),
        ]  # fmt: skip

    ties = jnp.asarray(RNG.integers(-1, 2, size=(BATCH, 2, 3, 2)), float)
    assert_same(f, ties)
    gradient = vmap(jax.grad(jnp.max))(jnp.asarray([[1.0, 2.0, 2.0]]))
    np.testing.assert_allclose(gradient, [[0, 0.5, 0.5]])
    assert_same(f, ties.at[0, 1, 1].set(jnp.nan), derivatives=())


@pytest.mark.parametrize(
    ("subscripts", "left", "right"),
    [
        ("ij,jk->ik", (2, 3), (3, 4)),
        ("ij,j->i", (2, 3), (3,)),
        ("i,i->", (3,), (3,)),
        ("i,j->ij", (2,), (3,)),
        ("bij,bjk->bik", (2, 2, 3), (2, 3, 2)),
        ("ibj,kjb->kib", (2, 3, 2), (2, 2, 3)),
        ("ijk,kji->", (2, 2, 3), (3, 2, 2)),
        ("ij,kj->ki", (2, 40), (3, 40)),
        ("ij,j->i", (2, 70), (70,)),
        ("ij,jk->ik", (0, 3), (3, 2)),
        ("ij,jk->ik", (2, 0), (0, 2)),
    ],
)
def test_products(subscripts, left, right):
    """Small and large, any axes, either operand shared."""
    f = lambda a, b: jnp.einsum(subscripts, a, b)  # noqa: E731
    _each_sharing(f, _normal(BATCH, *left), _normal(BATCH, *right), thorough=left == (2, 3))


def test_products_of_transposes():
    """Used once, twice, as a result, with three axes, and where the product has no rule."""

    def f(x, y, z):
        twice = y.T
        half = x.T.astype(jnp.float16) @ y.T.astype(jnp.float16)
        turned = jnp.tensordot(jnp.transpose(z, (2, 0, 1)), x.T, ((0, 1), (1, 0)))
        return [x.T @ y.T, twice @ x.T, twice, turned, half.astype(x.dtype)]

    _each_sharing(f, _normal(BATCH, 3, 4), _normal(BATCH, 4, 3), _normal(BATCH, 4, 5, 3))


def test_small_products_become_no_dot():
    """Which is where the speed on a CPU comes from; large ones with a shared operand do."""

    def text(f, *args, **axes):
        return jax.jit(vmap(f, **axes)).lower(*args).as_text()

    a, b = _normal(BATCH, 6, 6), _normal(BATCH, 6, 6)
    assert "dot_general" not in text(jnp.matmul, a, b)
    gradient = jax.grad(lambda a, b: jnp.sum(vmap(jnp.matmul)(a, b) ** 2))
    assert "dot_general" not in jax.jit(gradient).lower(a, b).as_text()
    assert "dot_general" in text(jnp.matmul, _normal(40, 40), _normal(BATCH, 40), in_axes=(None, 0))
    long, wide = _normal(BATCH, 9, 53), _normal(BATCH, 53, 9)  # a sum in two parts
    assert "dot_general" not in text(jnp.matmul, long, wide)
    np.testing.assert_allclose(vmap(jnp.matmul)(long, wide), long @ wide, atol=1e-12)


def test_second_derivative_of_products():
    """The product primitive differentiates to itself, any number of times."""
    a, x = _normal(BATCH, 3, 3), _normal(BATCH, 3)

    def hessian(batch, mode):
        return mode(jax.grad(lambda a, x: jnp.sum(batch(lambda a, x: jnp.tanh(a @ x))(a, x))))

    for mode in (jax.jacfwd, jax.jacrev):
        found = jax.jit(hessian(vmap, mode))(a, x)
        np.testing.assert_allclose(found, jax.jit(hessian(jax.vmap, mode))(a, x), atol=1e-12)


@pytest.mark.parametrize(
    ("rows", "left_side", "lower"),
    [
        (3, True, True),
        (3, False, False),
        (8, True, False),
        *(pytest.param(*case, marks=pytest.mark.slow) for case in itertools.product(
            (1, 3, 8), (True, False), (True, False)
        )),
    ],
)  # fmt: skip
def test_triangular_solve(rows, left_side, lower):
    """Every variant; the other triangle is never looked at."""

    def f(a, b):
        mask = jnp.tril(jnp.ones((rows, rows), bool))
        a = jnp.where(mask if lower else mask.T, a, jnp.nan) + 3 * jnp.eye(rows)
        options = {"left_side": left_side, "lower": lower}
        return [
            lax.linalg.triangular_solve(a, b, transpose_a=t, unit_diagonal=u, **options)
            for t, u in ((False, False), (True, False), (False, True), (True, True))
        ]

    shape = (rows, 2) if left_side else (2, rows)
    _each_sharing(f, _normal(BATCH, rows, rows) / rows, _normal(BATCH, *shape), tolerance=1e-8)


@pytest.mark.parametrize("rows", [1, 3, 8, 40])
def test_cholesky(rows):
    """Unrolled, by loops and left to the library; a batch of matrices inside, too."""

    def f(a):
        return jnp.linalg.cholesky(a @ a.swapaxes(-1, -2) + rows * jnp.eye(rows))

    modes = ("jvp", "vjp") if rows < 40 else ()
    assert_same(f, _normal(BATCH, rows, rows), derivatives=modes, tolerance=1e-8)
    if rows == 3:
        assert_same(lambda a: jax.vmap(f)(a), _normal(BATCH, 2, rows, rows), derivatives=modes)


@pytest.mark.parametrize("rows", [3, 8])
def test_cholesky_of_an_indefinite_matrix(rows):
    """NaN in the lane that fails, and in no other."""
    a = jnp.stack([jnp.eye(rows), jnp.eye(rows).at[rows - 1, rows - 1].set(-1.0)])
    assert_same(jnp.linalg.cholesky, a, derivatives=())


@pytest.mark.parametrize("rows", [1, 3, 7])
def test_lu(rows):
    """By loops and by the library; rows change places, a singular matrix is no error."""
    a = _normal(BATCH, rows, rows).at[-1, :, : rows // 2].set(0.0)
    assert_same(lax.linalg.lu, a, derivatives=(), tolerance=1e-12)


def test_other_linear_algebra():
    """Left to the library, a batch of matrices inside, too."""

    def f(a):
        spd = a @ a.T + 3 * jnp.eye(len(a))
        return [jnp.linalg.inv(spd), jnp.linalg.eigh(spd)[0], jnp.linalg.qr(spd)[1],
                jax.scipy.linalg.cho_solve((jnp.linalg.cholesky(spd), True), a)]  # fmt: skip

    assert_same(f, _normal(BATCH, 3, 3), tolerance=1e-7)
    assert_same(jax.vmap(f), _normal(BATCH, 2, 7, 7), derivatives=(), tolerance=1e-7)


ROUTINES = {
    "cholesky": lambda a: jnp.linalg.cholesky(a @ a.T + jnp.eye(40)),
    "lu": lambda a: jnp.linalg.solve(a, a[0]),
    "determinant": jnp.linalg.det,
    "triangular": lambda a: lax.linalg.triangular_solve(a, a),
    "qr": jnp.linalg.qr,
    "least squares": lambda a: jnp.linalg.lstsq(a[:, :9], a[0])[0],
    "symmetric eigenvalues": lambda a: jnp.linalg.eigh(a + a.T),
    "eigenvalues": jnp.linalg.eigvals,
    "singular values": jnp.linalg.svd,
    "schur": jax.scipy.linalg.schur,
    "tridiagonal": lambda a: lax.linalg.tridiagonal_solve(a[0], a[1], a[2], a),
}


@pytest.mark.skipif(jax.default_backend() != "cpu", reason="LAPACK is the library of a CPU")
@pytest.mark.parametrize("name", ROUTINES)
def test_the_library_gets_one_matrix_a_call(name):
    """It would wait, for ever if several devices do, for threads among which to divide a batch."""
    program = jax.jit(vmap(ROUTINES[name])).lower(_normal(BATCH, 40, 40)).as_text()
    calls = re.findall(r"@lapack_.*-> *(.*)", program)
    assert calls
    assert not [call for call in calls if re.search(r"tensor<\d+x\d+x\d+x", call)]


def test_indexing():
    """Shared and different indices, of shared and different arrays."""

    def f(x, i):
        j = jnp.stack([i, i + 1])
        return [
            x[i], x[j], x[:, i], x[j, j[::-1]], x[i, 1], x[np.array([2, 0])], x[jnp.array([[1]])],
            x.at[i].get(mode="fill", fill_value=7.0), x.at[i + 9].get(mode="fill"),
            x.at[i - 9].get(mode="clip"), jnp.take(x, j, axis=1, mode="wrap"),
            lax.dynamic_slice(x, (i, 0), (2, 2)), lax.dynamic_slice(x, (i, i), (1, 2)),
            jnp.take_along_axis(x, j[:, None], axis=0), lax.dynamic_index_in_dim(x, i, 1),
        ]  # fmt: skip

    i = jnp.asarray(RNG.integers(0, 3, size=BATCH))
    _each_sharing(f, _normal(BATCH, 4, 3), i)


@pytest.mark.parametrize("start", [-9, -7, -3, 9])
def test_slices_from_outside(start):
    """An index that is still negative after counting from the end is clipped, not counted again."""

    def f(x, y, i):
        return [
            x.at[i].get(mode="clip"), lax.dynamic_slice(x, (i, i), (2, 2)),
            lax.dynamic_update_slice(x, y, (i, i)), lax.dynamic_update_index_in_dim(x, y[0], i, 1),
        ]  # fmt: skip

    i = jnp.full(BATCH, start)
    _each_sharing(f, _normal(BATCH, 4, 3), _normal(BATCH, 2, 2), i, derivatives=())


def test_updates():
    """The same for scatters."""

    def f(x, y, i):
        j = jnp.stack([i, i + 1])
        return [
            x.at[i].set(y), x.at[i].add(y), x.at[j].add(y), x.at[:, i].multiply(2.0),
            x.at[j].max(y), x.at[j, 0].min(y[0]), x.at[i + 9].set(y), x.at[np.array([2, 0])].add(y),
            lax.dynamic_update_slice(x, y[None, :2], (i, i)), x.at[i, 1].set(0.0),
            lax.dynamic_update_index_in_dim(x, y, i, 0), jnp.zeros((3, 3)).at[i].set(y),
        ]  # fmt: skip

    i = jnp.asarray(RNG.integers(0, 3, size=BATCH))
    _each_sharing(f, _normal(BATCH, 4, 3), _normal(BATCH, 3), i)


def test_fallback():
    """Primitives without a rule: convolution, windows, Fourier transform."""

    def f(x):
        return [
            jnp.convolve(x, x[:2]), lax.reduce_window(x, -jnp.inf, lax.max, (2,), (1,), "SAME"),
            jnp.abs(jnp.fft.rfft(x)), lax.associative_scan(jnp.add, x), jnp.interp(0.3, x, x * 2),
        ]  # fmt: skip

    assert_same(f, jnp.cumsum(jnp.abs(_normal(BATCH, 5)), 1))


def test_random_numbers():
    """The same numbers, from keys per lane, shared keys and keys made inside."""

    def f(key, i):
        inside = jax.random.fold_in(jax.random.key(3), i)
        a, b = jax.random.split(key)
        return [
            a, jax.random.normal(a, (2,)), jax.random.randint(b, (), 0, 9),
            jax.random.uniform(inside, (3,)), jax.random.permutation(b, 4),
            jax.random.bernoulli(key, 0.3, (2, 2)), jax.random.key_data(inside),
            jnp.where(i > 1, a, b), jax.random.categorical(key, jnp.arange(3.0)),
            lax.scan(lambda k, _: (jax.random.split(k)[0], jax.random.normal(k)), key, None, 2),
            lax.cond(i > 1, lambda: a, lambda: b), jax.random.split(inside, 2),
            jax.random.normal(jax.random.PRNGKey(i)),
        ]  # fmt: skip

    keys = jax.random.split(jax.random.key(0), BATCH)
    _each_sharing(f, keys, jnp.arange(BATCH), derivatives=())


def test_callbacks():
    """Reach the host once for each lane, as asked."""

    def f(x):
        kind = jax.ShapeDtypeStruct((), x.dtype)
        return jax.pure_callback(np.sum, kind, x, vmap_method="sequential")

    assert_same(f, _normal(BATCH, 3), derivatives=())
