"""Functions of one matrix that call LAPACK, of which `jax.vmap` makes a loop on a CPU.

See `lapack` for the reason. `jaxsim.vmap` has rules of its own for what these functions call.
"""

from collections.abc import Callable

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend import core as jex
from jax.interpreters import ad, batching, mlir

from jaxsim.batching import forms, jaxprs
from jaxsim.batching.primitives.calls import jit
from jaxsim.batching.primitives.jvp_rule import moving_leaves
from jaxsim.batching.registry import register


def one_at_a_time(f: Callable) -> Callable:
    """Return `f`, a function of arrays to a list of arrays, so that LAPACK never gets a batch.

    `jax.vmap` maps it by a loop on a CPU and as usual on other platforms. Its derivatives are those
    of `f`, which `jax.vmap` maps as usual on a CPU, too.
    """

    def call(*xs):
        program = jax.make_jaxpr(f)(*[jaxprs.element(x, None) for x in xs])
        return one_at_a_time_p.bind(*xs, program=program, loop=jex.jaxpr_as_fun(program))

    return call


def _evaluate(*xs, program, loop):
    del loop
    return jex.jaxpr_as_fun(program)(*xs)


def _evaluate_loop(*xs, program, loop):
    del program
    return loop(*xs)


def _types(*kinds, program, loop):
    del loop
    return [jaxprs.varying_like(kind, *kinds) for kind in program.out_avals]


def _jvp(primals, tangents, *, program, loop):
    results = one_at_a_time_p.bind(*primals, program=program, loop=loop)
    given = [None if type(t) is ad.Zero else t for t in tangents]
    moved, given, others = moving_leaves(list(primals), given)
    f = lambda *some: jex.jaxpr_as_fun(program)(*others(*some))  # noqa: E731
    dots = jax.jvp(f, moved, given)[1]
    zeros = [ad.Zero(jax.typeof(x).to_tangent_aval()) for x in results]
    return results, [
        zero if dot.dtype == jax.dtypes.float0 else dot
        for zero, dot in zip(zeros, dots, strict=True)
    ]


def _batch(values, axes, *, program, loop):
    """The program of the whole batch, batch first, and a loop around the loop."""
    whole = jax.vmap(jex.jaxpr_as_fun(program), axes)
    on = [axis is not None for axis in axes]

    def outer(*xs):
        mapped = [jnp.moveaxis(x, a, 0) for x, a in zip(xs, axes, strict=True) if a is not None]

        def one(some):
            rest = iter(some)
            return loop(*[next(rest) if m else x for x, m in zip(xs, on, strict=True)])

        return lax.map(one, mapped)

    batched = jax.make_jaxpr(whole)(*[jaxprs.element(x, None) for x in values])
    results = one_at_a_time_p.bind(*values, program=batched, loop=outer)
    return results, [0] * len(results)


def _read(p):
    return forms.Jit(forms.program(p["program"]), "one_at_a_time")


one_at_a_time_p = jex.Primitive("one_at_a_time")
one_at_a_time_p.multiple_results = True
one_at_a_time_p.def_impl(_evaluate)
one_at_a_time_p.def_abstract_eval(_types)
ad.primitive_jvps[one_at_a_time_p] = _jvp
batching.primitive_batchers[one_at_a_time_p] = _batch
mlir.register_lowering(one_at_a_time_p, mlir.lower_fun(_evaluate, multiple_results=True))
mlir.register_lowering(
    one_at_a_time_p, mlir.lower_fun(_evaluate_loop, multiple_results=True), platform="cpu"
)
register("one_at_a_time", rule=jit, read=_read, in_section=True)
