"""Fusion barriers for XLA's CPU compiler.

That compiler recomputes an operand in every operation with which it is fused; along a chain of
operations, the cost grows exponentially. A call that is not inlined is computed once. An
optimisation barrier does not help, because XLA removes it before fusion. XLA's GPU compiler
compares the costs of recomputing and storing, and there every call would be an additional kernel.
So these calls are part of programs for CPUs only.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend import core as jex
from jax.interpreters import ad, batching, mlir

from jaxsim.batching import forms, jaxprs
from jaxsim.batching.primitives.calls import jit
from jaxsim.batching.primitives.operands import all_full
from jaxsim.batching.registry import register


def not_inlined():
    """A context in which calls of compiled functions are not inlined."""
    return set_xla_metadata(inlineable="false")


def fusion_barrier(x):
    """Return x, computed once before its uses."""
    return own_kernel(_identity, x)


def _identity(x):
    return x


def own_kernel(f: Callable, x, **options):
    """`f(x, **options)`, computed on a CPU by a separate kernel, once for all uses.

    Its derivatives are those of f, without such kernels. `f` maps one array to one array, and the
    options must be hashable.
    """
    kind: Any = jaxprs.element(x, None)
    if kind is x:  # it varies over the devices of a `jax.shard_map`, and is traced as it is
        program = jax.make_jaxpr(functools.partial(f, **options))(x)
    else:
        program = _program(f, kind, tuple(options.items()), jax.sharding.get_abstract_mesh())
    return own_kernel_p.bind(x, program=program)


@functools.lru_cache(maxsize=1024)
def _program(f: Callable, kind, options: tuple, mesh):
    """The function's program; within `jax.shard_map`, its types contain the current mesh."""
    del mesh
    return jax.make_jaxpr(functools.partial(f, **dict(options)))(kind)


def _type(x, *, program):
    (result,) = program.out_avals
    return jaxprs.varying_like(result, x)


def _jvp(primals, tangents, *, program):
    f = functools.partial(_evaluate, program=program)
    return own_kernel_p.bind(*primals, program=program), jax.jvp(f, primals, tangents)[1]


def _transpose(cotangent, x, *, program):
    if type(cotangent) is ad.Zero:
        return [ad.Zero(x.aval)]
    f = functools.partial(_evaluate, program=program)
    return jax.linear_transpose(f, x.aval)(cotangent)


def _batch(values, axes, *, program):
    """`jax.vmap` of the function, batch first."""
    f = jax.vmap(functools.partial(_evaluate, program=program), axes)
    batched = jax.make_jaxpr(f)(jaxprs.element(values[0], None))
    return own_kernel_p.bind(values[0], program=batched), 0


def _evaluate(x, *, program):
    (result,) = jex.jaxpr_as_fun(program)(x)
    return result


def _call(x, *, program):
    with not_inlined():
        return _compiled(program)(x)


@functools.lru_cache(maxsize=1024)
def _compiled(program) -> Callable:
    return jax.jit(functools.partial(_evaluate, program=program))


own_kernel_p = jex.Primitive("own_kernel")
own_kernel_p.def_impl(jax.jit(own_kernel_p.bind, static_argnames="program"))
own_kernel_p.def_abstract_eval(_type)
ad.primitive_jvps[own_kernel_p] = _jvp
ad.primitive_transposes[own_kernel_p] = _transpose
batching.primitive_batchers[own_kernel_p] = _batch
mlir.register_lowering(own_kernel_p, mlir.lower_fun(_evaluate, multiple_results=False))
mlir.register_lowering(own_kernel_p, mlir.lower_fun(_call, multiple_results=False), platform="cpu")


def barrier_rule(lanes, eqn, values, flags):
    """The rule of `lax.optimization_barrier`, with fusion barriers on a CPU."""
    return [fusion_barrier(v) for v in all_full(lanes, values, flags)]


def _read_own_kernel(p):
    return forms.Jit(forms.program(p["program"]), "own_kernel")


register("own_kernel", rule=jit, read=_read_own_kernel, in_section=True)
register("optimization_barrier", rule=barrier_rule)
