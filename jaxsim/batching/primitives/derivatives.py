"""Batched calls of functions with custom derivatives, which keep their derivatives.

The batched call gets a new rule, by `with_jvp_rule` or `jax.custom_vjp`: the derivative of the
original call by `jax.jvp` or `jax.vjp`, evaluated for all lanes. So it does not matter how JAX
stores the original rule.
"""

import functools
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from flax import struct

from jaxsim.batching import forms, jaxprs
from jaxsim.batching.primitives.jvp_rule import with_jvp_rule
from jaxsim.batching.registry import register


def custom_call(lanes, eqn, values, flags):
    """A call of a `custom_jvp` or `custom_vjp` function."""
    form = forms.read(eqn)
    if form is None:
        return None
    wrap = with_jvp if form.kind == "jvp" else with_vjp
    return wrap(lanes, eqn, flags, lambda *xs: lanes.evaluate_full(form.body, xs, flags))(*values)


def linear_solve(lanes, eqn, values, flags):
    """A `custom_linear_solve`: each of its programs is batched."""
    form = forms.read(eqn)
    if form is None:
        return None
    first = sum(form.counts.values())
    b = [lanes.broadcast(v, f) for v, f in zip(values[first:], flags[first:], strict=True)]
    begin, programs = 0, {}
    for name, body in form.parts.items():
        end = begin + form.counts[name]
        on = [*flags[begin:end], *[True] * len(b)]
        if body is not None:
            run = functools.partial(lanes.evaluate_full, body, flags=on)
            programs[name] = jax.make_jaxpr(lambda *xs, run=run: run(xs))(*values[begin:end], *b)
        begin = end
    return eqn.primitive.bind(*values[:first], *b, **form.replace(programs))


def with_jvp(lanes, eqn, flags, batched: Callable) -> Callable:
    """`batched` with the forward derivative of the equation."""
    one_lane = jaxprs.rebind(eqn)

    def rule(primals, tangents):
        moving = [t is not None for t in tangents]

        def derivative(*values):
            xs, ts = values[: len(flags)], list(values[len(flags) :])
            partial, starts = _restrict(one_lane, xs, moving)
            out, dots = jax.jvp(partial, starts, ts)
            return [*out, *(d for d in dots if d.dtype != jax.dtypes.float0)]

        values = [*primals, *_where(moving, tangents)]
        results = lanes.apply(derivative, values, [*flags, *_where(moving, flags)])
        out, dots = results[: len(eqn.outvars)], iter(results[len(eqn.outvars) :])
        return out, [next(dots) if _is_smooth(o) else None for o in out]

    return with_jvp_rule(batched, rule)


def with_vjp(lanes, eqn, flags, batched: Callable) -> Callable:
    """`batched` with the backward derivative of the equation."""
    one_lane, count = jaxprs.rebind(eqn), len(eqn.outvars)
    smooth = [_is_smooth(v.aval) for v in eqn.invars]
    call = jax.custom_vjp(batched)

    def forward(*primals):
        structure = []

        def derivative(*xs):
            partial, starts = _restrict(one_lane, xs, smooth)
            out, pull = jax.vjp(partial, *starts)
            leaves, treedef = jax.tree.flatten(pull)
            structure.append(treedef)
            return [*out, *leaves]

        program = lanes.trace(derivative, primals, flags)
        results, on = lanes.evaluate(program, primals, flags)
        out = [lanes.broadcast(v, f) for v, f in zip(results[:count], on[:count], strict=True)]
        return out, Residuals(results[count:], tuple(on[count:]), structure[0])

    def backward(saved: Residuals, cotangents):
        def derivative(*values):
            leaves, given = values[: len(saved.flags)], iter(values[len(saved.flags) :])
            cts = [next(given) if _is_smooth(c) else c[..., 0] for c in cotangents]
            return list(jax.tree.unflatten(saved.treedef, leaves)(cts))

        given = [c for c in cotangents if _is_smooth(c)]
        on = [*saved.flags, *[True] * len(given)]
        found = lanes.apply(derivative, [*saved.leaves, *given], on)
        on = _where(smooth, flags)
        found = iter([x if f else jnp.sum(x, -1) for x, f in zip(found, on, strict=True)])
        return tuple(next(found) if s else None for s in smooth)

    call.defvjp(forward, backward)
    return call


@struct.dataclass
class Residuals:
    """Residuals of the backward pass: the leaves of the original's pullback, and its structure."""

    leaves: list
    flags: tuple = struct.field(pytree_node=False)
    treedef: Any = struct.field(pytree_node=False)


def _restrict(f: Callable, xs, moving) -> tuple[Callable, list]:
    """The function of the operands with `moving` only, and their values."""

    def partial(*some):
        rest = iter(some)
        return f(*[next(rest) if m else x for x, m in zip(xs, moving, strict=True)])

    return partial, _where(moving, xs)


def _where(mask, items) -> list:
    return [item for item, m in zip(items, mask, strict=True) if m]


def _is_smooth(x) -> bool:
    """Whether x may have nonzero tangents; false for integers and their float0 cotangents."""
    return jnp.issubdtype(x.dtype, jnp.inexact)


def _read_linear_solve(p):
    kinds, counts = p["jaxprs"], p["const_lengths"]
    parts = {k: v if v is None else forms.program(v) for k, v in kinds._asdict().items()}
    replace = lambda new: {**p, "jaxprs": kinds._replace(**new)}  # noqa: E731
    return forms.LinearSolve(parts, {k: getattr(counts, k) or 0 for k in parts}, replace)


def _custom(parameter: str, kind: str):
    return lambda p: forms.Custom(forms.program(p[parameter]), kind)


for name, parameter, kind in (
    ("custom_jvp_call", "call_jaxpr", "jvp"),
    ("custom_vjp_call", "call_jaxpr", "vjp"),
    ("jvp_rule", "program", "jvp"),
):
    register(name, rule=custom_call, read=_custom(parameter, kind), in_section=True)
register("custom_linear_solve", rule=linear_solve, read=_read_linear_solve)
