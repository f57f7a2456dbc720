"""Runs one function through `jax.vmap` and `jaxsim.batching.vmap` and compares all it can give."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxsim.batching import vmap

# Compiled once and run once: no time for optimisation.
QUICK = {"xla_backend_optimization_level": 0, "xla_llvm_disable_expensive_passes": True}


def compiled(f, *args):
    """f(*args), compiled without optimisation."""
    return jax.jit(f).lower(*args).compile(compiler_options=QUICK)(*args)


def assert_equal(found, expected, tolerance=1e-9):
    """Same tree, shapes, types, weak types and numbers."""
    assert jax.tree.structure(found) == jax.tree.structure(expected)
    for a, b in zip(jax.tree.leaves(found), jax.tree.leaves(expected), strict=True):
        a, b = jnp.asarray(a), jnp.asarray(b)
        assert (a.shape, a.dtype) == (b.shape, b.dtype)
        if jnp.issubdtype(a.dtype, jax.dtypes.prng_key):
            a, b = jax.random.key_data(a), jax.random.key_data(b)
        assert a.weak_type == b.weak_type
        np.testing.assert_allclose(np.asarray(a), np.asarray(b), rtol=tolerance, atol=tolerance)


def assert_same(f, *args, derivatives=("jvp", "vjp"), tolerance=1e-9, **axes):
    """Values, and derivatives outside and inside, agree with those of `jax.vmap`."""

    def everything(batch):
        return lambda *args: with_derivatives(batch, f, args, axes, derivatives)

    assert_equal(
        compiled(everything(vmap), *args), compiled(everything(jax.vmap), *args), tolerance
    )


def with_derivatives(batch, f, args, axes, derivatives):
    """Values of f in a batch, and derivatives outside and inside of it, by name."""
    batched = batch(f, **axes)
    out = {"value": batched(*args)}
    if "jvp" in derivatives:
        out["jvp of vmap"] = directional(batched)(*args)
        out["vmap of jvp"] = batch(directional(f), **axes)(*args)
    if "vjp" in derivatives:
        out["vjp of vmap"] = gradient(batched)(*args)
        out["vmap of vjp"] = batch(gradient(f), in_axes=axes.get("in_axes", 0))(*args)
    return out


def directional(f):
    """Derivative of f along the arguments' own values, without integers."""

    def derivative(*args):
        moving = [_is_float(a) for a in args]

        def partial(*some):
            return [x for x in jax.tree.leaves(_merge(f, args, moving, some)) if _is_float(x)]

        some = [a for a, m in zip(args, moving, strict=True) if m]
        return jax.jvp(partial, some, [jnp.cos(3 * a) for a in some])[1]

    return derivative


def gradient(f):
    """Gradient of a nonlinear function of all results."""

    def derivative(*args):
        moving = [_is_float(a) for a in args]

        def scalar(*some):
            out = jax.tree.leaves(_merge(f, args, moving, some))
            return sum((jnp.sum(jnp.sin(x)) for x in out if _is_float(x)), 0.0)

        some = [a for a, m in zip(args, moving, strict=True) if m]
        return jax.grad(scalar, tuple(range(len(some))))(*some)

    return derivative


def _merge(f, args, moving, some):
    rest = iter(some)
    return f(*[next(rest) if m else a for a, m in zip(args, moving, strict=True)])


def _is_float(x):
    return jnp.issubdtype(jnp.result_type(x), jnp.floating)
