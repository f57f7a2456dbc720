"""A traced function as one equation, which becomes one kernel for all lanes of a batch.

The equation carries its program, as a call of a jitted function does. Derivatives are those of the
program, whose equations then stand in its place; on other platforms, and where the compiler does
not know something, the program is evaluated as if it had been written there.
"""

import functools
import warnings
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
from jax.extend import core as jex
from jax.interpreters import ad, batching, mlir

from jaxsim.arrays import tuning
from jaxsim.arrays.memo import is_traced
from jaxsim.batching import forms, jaxprs, registry
from jaxsim.batching.interpret import Lanes
from jaxsim.batching.primitives.jvp_rule import moving_leaves
from jaxsim.lanes.switch import within_kernel


def as_kernel(f: Callable, largest: int | None = None, *, finite_math: bool = False) -> Callable:
    """The same function, compiled as one kernel where it is mapped over a batch.

    It means what `f` means, under `jit`, `vmap` and derivatives. It pays for functions of some
    hundred operations and more; the machine code stays until the process ends. Where its program is
    larger than `largest`, draws random numbers, or has numbers of a model that is
    being traced, the call stands for its equations, which XLA compiles.

    Args:
      f: a function of pytrees of arrays, written for one element.
      largest: the most scalars that its program may compute; None for what `arrays.tuning` says.
      finite_math: whether a product with a number known to be zero is zero, even of NaN. Axes and
        inertias have many zeros. The function has to say itself what it returns for arguments that
        are not finite.
    """

    @functools.wraps(f)
    def call(*args):
        leaves, tree = jax.tree.flatten(args)
        kinds = [jaxprs.element(x, None) for x in leaves]
        flat = lambda *xs: f(*jax.tree.unflatten(tree, xs))  # noqa: E731
        with within_kernel():
            traced, shapes = jax.make_jaxpr(flat, return_shape=True)(*kinds)
        if not _fits(traced, _largest() if largest is None else largest):
            return f(*args)
        results = _bind(traced, leaves, finite_math)
        return jax.tree.unflatten(jax.tree.structure(shapes), results)

    return call


def _largest() -> int:
    on_cpu = jax.default_backend() == "cpu"
    return tuning.KERNEL_SCALARS if on_cpu else tuning.GPU_KERNEL_SCALARS


def _fits(traced, largest: int) -> bool:
    """Whether the compiler may be given a program."""
    eqns, known = traced.jaxpr.eqns, not is_traced(traced.consts)
    return known and jaxprs.num_scalars(eqns) <= largest and not jaxprs.has_keys(eqns)


def _bind(traced, leaves: Sequence, finite_math: bool) -> list:
    """One equation for what is computed; results that are operands pass it by."""
    jaxpr = traced.jaxpr
    known = dict(zip(jaxpr.invars, leaves, strict=True))
    for v, c in zip(jaxpr.constvars, traced.consts, strict=True):
        known[v] = c
    computed = [v for v in jaxpr.outvars if not isinstance(v, jex.Literal) and v not in known]
    computed = list(dict.fromkeys(computed))
    program = traced.replace(
        jaxpr=jaxpr.replace(outvars=computed, debug_info=_debug(jaxpr, computed))
    )
    results = lane_call_p.bind(*leaves, program=program, finite_math=finite_math)
    found = dict(zip(computed, results, strict=True))
    return [
        jnp.asarray(v.val, v.aval.dtype) if isinstance(v, jex.Literal) else {**known, **found}[v]
        for v in jaxpr.outvars
    ]


def _debug(jaxpr, computed):
    names = ("",) * len(jaxpr.invars), ("",) * len(computed)
    return jex.DebugInfo("kernel", "jaxsim.lanes", *names)


def _evaluate(*xs, program, finite_math=False):
    return jex.jaxpr_as_fun(program)(*xs)


def _types(*kinds, program, finite_math):
    return [jaxprs.varying_like(kind, *kinds) for kind in program.out_avals]


def _jvp(primals, tangents, *, program, finite_math):
    return _moving_jvp(functools.partial(_evaluate, program=program), primals, tangents)


def _moving_jvp(f: Callable, primals, tangents):
    """Results, and their derivatives along those operands that move."""
    along = [None if type(t) is ad.Zero else t for t in tangents]
    moved, given, with_leaves = moving_leaves(list(primals), along)
    return jax.jvp(lambda *xs: f(*with_leaves(*xs)), moved, given)


def _batch(values, axes, *, program, finite_math):
    """`jax.vmap`: the lanes go to the end."""
    size = next(x.shape[a] for x, a in zip(values, axes, strict=True) if a is not None)
    moved = [x if a is None else jnp.moveaxis(x, a, -1) for x, a in zip(values, axes, strict=True)]
    flags = tuple(a is not None for a in axes)
    results = lane_batch_p.bind(
        *moved, program=program, flags=flags, size=size, finite_math=finite_math
    )
    return results, [x.ndim - 1 for x in results]


def _rule(lanes, eqn, values, flags):
    """`jaxsim.vmap`: the lanes are there already."""
    return lane_batch_p.bind(*values, **eqn.params, flags=tuple(flags), size=lanes.size)


def _alone(*xs, program, finite_math, made_for: Callable):
    """One lane."""
    made = _or_none(made_for, program, (True,) * len(xs), finite_math)
    if made is None:
        return _evaluate(*xs, program=program)
    shapes = [jax.ShapeDtypeStruct((*a.shape, 1), a.dtype) for a in program.out_avals]
    return [x[..., 0] for x in jax.ffi.ffi_call(made.name, shapes)(*[x[..., None] for x in xs])]


def _scalar_kernel(program, flags: tuple[bool, ...], finite_math: bool):
    from jaxsim.lanes.compiler import kernel

    return kernel(program, flags, finite_math, single=True)


def _vector_kernel(program, flags: tuple[bool, ...], finite_math: bool):
    from jaxsim.lanes.compiler import kernel

    return kernel(program, flags, finite_math)


def _thread_kernel(program, flags: tuple[bool, ...], finite_math: bool):
    from jaxsim.lanes.compiler import gpu_kernel
    from jaxsim.lanes.gpu import driver

    return gpu_kernel(program, flags, finite_math, driver.capability())


def _or_none(make: Callable, *args):
    """A kernel, or None with a warning where the compiler does not know something."""
    try:
        return make(*args)
    except (NotImplementedError, ImportError) as reason:
        _warn(str(reason))
        return None


def _lowering(by_kernel: Callable, made_for: Callable, by_xla: Callable):
    """A lowering to a kernel; programs to be exported, which another process runs, are XLA's."""
    here = mlir.lower_fun(functools.partial(by_kernel, made_for=made_for), multiple_results=True)
    anywhere = mlir.lower_fun(by_xla, multiple_results=True)

    def lower(ctx, *args, **params):
        parameters = getattr(ctx.module_context, "lowering_parameters", None)
        exported = getattr(parameters, "for_export", False)
        return (anywhere if exported else here)(ctx, *args, **params)

    return lower


@functools.cache
def _warn(reason: str) -> None:
    """Say, once for each reason, that a program stays with XLA."""
    warnings.warn(f"jaxsim.lanes leaves a program to XLA: it does not know {reason}", stacklevel=2)


lane_call_p = jex.Primitive("lane_call")
lane_call_p.multiple_results = True
lane_call_p.def_impl(jax.jit(lane_call_p.bind, static_argnames=("program", "finite_math")))
lane_call_p.def_abstract_eval(_types)
ad.primitive_jvps[lane_call_p] = _jvp
batching.primitive_batchers[lane_call_p] = _batch
mlir.register_lowering(lane_call_p, mlir.lower_fun(_evaluate, multiple_results=True))
mlir.register_lowering(lane_call_p, _lowering(_alone, _scalar_kernel, _evaluate), platform="cpu")
mlir.register_lowering(lane_call_p, _lowering(_alone, _thread_kernel, _evaluate), platform="cuda")
registry.register("lane_call", rule=_rule)


def _batch_types(*kinds, program, flags, size, finite_math):
    return [
        jaxprs.varying_like(a.update(shape=(*a.shape, size)), *kinds) for a in program.out_avals
    ]


def _by_xla(*xs, program, flags, size, finite_math=False):
    """All lanes as XLA's program."""
    lanes = Lanes(size)
    return lanes.evaluate_full(forms.program(program), list(xs), list(flags))


def _by_kernel(*xs, program, flags, size, finite_math, made_for: Callable):
    """All lanes as one kernel; a batch shorter than a group is filled up with its last lane."""
    made = _or_none(made_for, program, flags, finite_math)
    if made is None:
        return _by_xla(*xs, program=program, flags=flags, size=size)
    rows = max(made.width, size)
    fill = lambda x: jnp.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, rows - size)], "edge")  # noqa: E731
    if rows > size:
        xs = [fill(x) if on else x for x, on in zip(xs, flags, strict=True)]
    shapes = [jax.ShapeDtypeStruct((*a.shape, rows), a.dtype) for a in program.out_avals]
    results = jax.ffi.ffi_call(made.name, shapes)(*xs)
    return [x[..., :size] for x in results] if rows > size else results


def _batch_jvp(primals, tangents, **params):
    return _moving_jvp(functools.partial(_by_xla, **params), primals, tangents)


def _more_lanes(values, axes, *, program, flags, size, finite_math):
    """`jax.vmap` of a batch: a longer one."""
    more = next(x.shape[a] for x, a in zip(values, axes, strict=True) if a is not None)
    wide, now = [], []
    for x, axis, on in zip(values, axes, flags, strict=True):
        now.append(on or axis is not None)
        if axis is None and not on:
            wide.append(x)
            continue
        x = x[..., None] if axis is None else jnp.moveaxis(x, axis, -1)
        x = x if on else x[..., None, :]
        x = jnp.broadcast_to(x, (*x.shape[:-2], size, more))
        wide.append(x.reshape(*x.shape[:-2], size * more))
    results = lane_batch_p.bind(
        *wide, program=program, flags=tuple(now), size=size * more, finite_math=finite_math
    )
    results = [x.reshape(*x.shape[:-1], size, more) for x in results]
    return results, [x.ndim - 1 for x in results]


lane_batch_p = jex.Primitive("lane_batch")
lane_batch_p.multiple_results = True
lane_batch_p.def_impl(
    jax.jit(lane_batch_p.bind, static_argnames=("program", "flags", "size", "finite_math"))
)
lane_batch_p.def_abstract_eval(_batch_types)
ad.primitive_jvps[lane_batch_p] = _batch_jvp
batching.primitive_batchers[lane_batch_p] = _more_lanes
mlir.register_lowering(lane_batch_p, mlir.lower_fun(_by_xla, multiple_results=True))
for platform, made_for in {"cpu": _vector_kernel, "cuda": _thread_kernel}.items():
    rule = _lowering(_by_kernel, made_for, _by_xla)
    mlir.register_lowering(lane_batch_p, rule, platform=platform)
