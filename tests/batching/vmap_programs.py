"""Random programs: compositions of operations on scalars, vectors, matrices and integers."""

from collections.abc import Callable
from dataclasses import dataclass

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

N = 3
TABLE = np.linspace(-1.0, 1.0, 12).reshape(4, 3)


def _spd(m):
    return m @ m.T + 2 * jnp.eye(N, dtype=m.dtype)


def _scan(v, m):
    def step(carry, row):
        x, count, table = carry
        return (jnp.tanh(m @ x + row), count + 1, table), jnp.sum(x * row) * count

    start = (v, 0, jnp.asarray(TABLE, v.dtype))
    (x, count, table), ys = lax.scan(step, start, m)
    return x + ys + table[count % 4]


def _reverse_scan(v, m):
    return lax.scan(lambda c, x: (0.5 * c + x, c * x), jnp.sum(m), v, reverse=True, unroll=2)[1]


def _fori(v, m):
    return lax.fori_loop(0, 3, lambda i, x: x.at[i].set(jnp.sin(x[(i + 1) % N])) * 0.9, v)


def _while(v, s):
    def body(carry):
        i, x, limit = carry
        return i + 1, x * 1.5 + 0.1, limit

    def wants(carry):
        i, x, limit = carry
        return (i < 8) & (jnp.sum(x * x) < limit)

    i, x, _ = lax.while_loop(wants, body, (0, jnp.tanh(v), 5.0 + s * s))
    return x / (1 + i)


def _while_shared(v, s):
    return lax.while_loop(lambda c: c[0] < 3, lambda c: (c[0] + 1, jnp.cos(c[1]) * s), (0, v))[1]


def _switch(i, v):
    branches = [jnp.sin, lambda x: x * x, lambda x: jnp.full_like(x, 0.5)]
    return lax.switch(i % 3, branches, v)


def _scatter(v, i):
    places = jnp.stack([i % N, jnp.zeros_like(i)])
    return jnp.zeros_like(v).at[places].add(v[:2]) + v.at[i % N].multiply(0.5)


@jax.custom_jvp
def _odd_square(x):
    return x * x


@_odd_square.defjvp
def _odd_square_jvp(primals, tangents):
    (x,), (t,) = primals, tangents
    return _odd_square(x), 5 * x * t  # deliberately not 2 x t


@jax.custom_vjp
def _odd_product(x, y):
    return x * y


_odd_product.defvjp(lambda x, y: (x * y, (x, y)), lambda r, c: (3 * c * r[1], -c * r[0]))

# Result kind, operand kinds, function. Kinds: s scalar, v vector, m matrix, i integer.
OPERATIONS: list[tuple[str, str, Callable]] = [
    ("s", "ss", lambda a, b: jnp.tanh(a) * b + 1),
    ("s", "ss", jnp.maximum),
    ("s", "v", jnp.sum),
    ("s", "v", lambda v: jax.nn.logsumexp(v)),
    ("s", "vv", jnp.dot),
    ("s", "m", jnp.trace),
    ("s", "vi", lambda v, i: v[i % N]),
    ("s", "si", lambda s, i: jnp.where(i > 1, s, -s)),
    ("s", "ss", lambda a, b: lax.cond(a > b, lambda: a * 2, lambda: jnp.sin(b))),
    ("s", "m", lambda m: jnp.linalg.det(_spd(m)) * 0.01),
    ("v", "v", jnp.tanh),
    ("v", "v", lambda v: v / jnp.sqrt(1 + jnp.dot(v, v))),
    ("v", "vv", jnp.cross),
    ("v", "vv", lambda a, b: jnp.where(a > b, a, jnp.cos(b))),
    ("v", "sv", lambda s, v: jnp.clip(v, -1, 1) * s),
    ("v", "mv", lambda m, v: m @ v),
    ("v", "v", lambda v: jnp.asarray(TABLE, v.dtype)[:3] @ v),
    ("v", "vm", lambda v, m: v @ m),
    ("v", "v", jnp.sort),
    ("v", "v", jnp.cumsum),
    ("v", "v", lambda v: v[::-1]),
    ("v", "v", lambda v: jnp.pad(v, (1, 1))[np.array([0, 2, 4])]),
    ("v", "mi", lambda m, i: lax.dynamic_index_in_dim(m, i % N, keepdims=False)),
    ("v", "vi", lambda v, i: lax.dynamic_update_slice(v, v[:1] * 2, (i % N,))),
    ("v", "vi", _scatter),
    ("v", "vm", _scan),
    ("v", "vm", _reverse_scan),
    ("v", "vm", _fori),
    ("v", "vs", _while),
    ("v", "vs", _while_shared),
    ("v", "iv", _switch),
    ("v", "v", _odd_square),
    ("v", "vv", _odd_product),
    ("v", "v", jax.checkpoint(lambda v: jnp.sin(jnp.sin(v)))),
    ("v", "v", jax.jit(lambda v: jnp.exp(-v * v))),
    ("v", "mv", lambda m, v: jnp.linalg.solve(_spd(m), v)),
    ("v", "mm", lambda a, b: jnp.einsum("ij,ji->i", a, b)),
    ("v", "i", lambda i: jnp.asarray(TABLE)[i % 4]),
    ("m", "vv", jnp.outer),
    ("m", "mm", lambda a, b: jnp.tanh(a @ b)),
    ("m", "m", lambda m: jnp.linalg.cholesky(_spd(m))),
    ("m", "m", jnp.transpose),
    ("m", "mv", lambda m, v: jnp.concatenate([m[1:], v[None]])),
    ("m", "v", lambda v: jnp.diag(v) + jnp.eye(N, dtype=v.dtype)),
    ("m", "m", lambda m: m.reshape(9)[np.arange(9)[::-1]].reshape(N, N)),
    ("m", "m", lambda m: lax.linalg.triangular_solve(_spd(m), m, left_side=True, lower=True)),
    ("m", "m", lambda m: jnp.stack(jnp.split(m, 3)[::-1]).reshape(N, N)),
    ("m", "mi", lambda m, i: jnp.roll(m, 1, axis=0) * (i % 3)),
    ("i", "v", jnp.argmax),
    ("i", "iv", lambda i, v: i + jnp.sum(v > 0, dtype=i.dtype)),
    ("i", "ii", lambda a, b: a * 3 + b // 2),
]
WITHOUT_REVERSE = (_while, _while_shared)
WITHOUT_FORWARD = (_odd_product,)


def derivative_modes(functions) -> tuple[str, ...]:
    """The modes of differentiation that all these functions have."""
    lacking = {"jvp": WITHOUT_FORWARD, "vjp": WITHOUT_REVERSE}
    return tuple(mode for mode, bad in lacking.items() if not any(f in bad for f in functions))


@dataclass(frozen=True)
class Program:
    """Steps (operation, indices of its operands among the values of their kinds)."""

    steps: tuple

    @property
    def modes(self) -> tuple[str, ...]:
        """The modes of differentiation that it has."""
        return derivative_modes([step[0][2] for step in self.steps])

    def __call__(self, s, v, m, i):
        """Last value of each kind."""
        values = {"s": [s], "v": [v], "m": [m], "i": [i]}
        for (kind, kinds, f), operands in self.steps:
            given = [values[k][o % len(values[k])] for k, o in zip(kinds, operands, strict=True)]
            values[kind].append(f(*given))
        return {kind: column[-1] for kind, column in values.items()}


def random_program(seed: int, length: int) -> Program:
    """A program that prefers recent values, so that most steps matter."""
    rng = np.random.default_rng(seed)
    steps = []
    for _ in range(length):
        operation = OPERATIONS[rng.integers(len(OPERATIONS))]
        steps.append((operation, [-1 - int(rng.integers(3)) for _ in operation[1]]))
    return Program(tuple(steps))


def arguments(seed: int, size: int):
    """A batch of arguments; the matrix is shared by all lanes for odd seeds."""
    rng = np.random.default_rng(seed)
    s, v, m = (rng.normal(size=(size, N, N)[: 1 + rank]) for rank in range(3))
    i = jnp.asarray(rng.integers(0, 4, size=size))
    axes = (0, 0, 0, 0)
    if seed % 2:
        m, axes = m[0], (0, 0, None, 0)
    return (jnp.asarray(s), jnp.asarray(v), jnp.asarray(m), i), axes
