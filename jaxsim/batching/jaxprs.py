"""Tools for JAX's traced programs, equations and types, that read no form of them."""

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
from jax import lax
from jax.extend import core as jex

from jaxsim.batching import registry


def is_divided(sharding) -> bool:
    """Whether a sharding, None included, divides any axis.

    Within `jax.shard_map` JAX attaches some that do not.
    """
    return any(axis is not None for axis in getattr(sharding, "spec", ()))


def rebind(eqn) -> Callable:
    """The equation as a function of all its operands, with its custom rules in force."""
    operands = [v for v in eqn.invars if not isinstance(v, jex.Literal)]
    unique = list(dict.fromkeys(operands))
    keep = [eqn.invars.index(v) for v in unique]
    jaxpr = _jaxpr(unique, eqn.outvars, [eqn], eqn.effects)
    call = jex.jaxpr_as_fun(jex.ClosedJaxpr(jaxpr, ()))
    return lambda *values: call(*[values[i] for i in keep])


def bodies(eqn) -> Iterator[Any]:
    """The jaxprs in an equation's parameters."""
    for value in eqn.params.values():
        for part in value if isinstance(value, tuple | list) else (value,):
            inner = getattr(part, "jaxpr", part)
            if hasattr(inner, "eqns"):
                yield inner


def length(eqns: Sequence) -> int:
    """Number of equations, with those of all that they call."""
    return sum(1 + sum(length(jaxpr.eqns) for jaxpr in bodies(eqn)) for eqn in eqns)


def with_bodies(eqn, change: Callable):
    """The equation with other jaxprs where it loops or branches, conditions of loops excepted.

    `change` takes and returns an open jaxpr with the same operands and results.
    """
    name = registry.find(eqn).bodies
    if name is None:
        return eqn
    value = eqn.params[name]
    if isinstance(value, tuple):
        value = tuple(with_jaxpr(part, change) for part in value)
    else:
        value = with_jaxpr(value, change)
    return eqn.replace(params={**eqn.params, name: value})


def with_jaxpr(jaxpr, change: Callable):
    """A closed jaxpr with its open one changed; jax 0.12 has one type for both."""
    if isinstance(jaxpr, jex.Jaxpr):
        return change(jaxpr)
    return jaxpr.replace(jaxpr=change(jaxpr.jaxpr))


def closed(invars, outvars, eqns):
    """A closed jaxpr of some equations without effects."""
    return jex.ClosedJaxpr(_jaxpr(invars, outvars, eqns, frozenset()), ())


def open_program(traced) -> tuple[Any, tuple]:
    """A jaxpr whose constants have become its first operands, and these constants."""
    jaxpr, consts = traced.jaxpr, tuple(traced.consts)
    if consts:
        invars = [*jaxpr.constvars, *jaxpr.invars]
        jaxpr = _jaxpr(invars, jaxpr.outvars, jaxpr.eqns, jaxpr.effects)
    return jaxpr, consts


def _jaxpr(invars, outvars, eqns, effects):
    names = ("",) * len(invars), ("",) * len(outvars)
    return jex.Jaxpr(
        (), invars, outvars, eqns, effects, jex.DebugInfo("vmap", "jaxsim.vmap", *names)
    )


def element(value, axis: int | None):
    """An array, or the type of one, that is like one element of a value along `axis`.

    For None it is like the value itself. Inside `shard_map` the type says over which mesh axes
    the value varies, and only a slice of the value carries this faithfully.
    """
    kind = jax.typeof(value)
    if _varying(kind):
        return value if axis is None else lax.index_in_dim(value, 0, axis, keepdims=False)
    shape = list(kind.shape)
    if axis is not None:
        del shape[axis]
    weak = getattr(kind, "weak_type", False)
    return jax.ShapeDtypeStruct(tuple(shape), kind.dtype, weak_type=weak)


def match_varying(*values) -> list:
    """Inside `shard_map`: make all values vary over the mesh axes that one of them varies over."""
    axes = [_varying(jax.typeof(v)) for v in values]
    union = frozenset().union(*axes)
    return [
        lax.pcast(v, tuple(union - own), to="varying") if union - own else v
        for v, own in zip(values, axes, strict=True)
    ]


def _varying(kind) -> frozenset:
    """Mesh axes of `shard_map` over which values of this type differ."""
    return frozenset(getattr(getattr(kind, "manual_axis_type", None), "varying", ()))


def result_type(f: Callable, *kinds):
    """Type of f's result, from the types of its operands."""
    (result,) = jax.make_jaxpr(f)(
        *[jax.ShapeDtypeStruct(k.shape, k.dtype) for k in kinds]
    ).out_avals
    return varying_like(result, *kinds)


def varying_like(kind, *others):
    """The type, varying over the mesh axes of `shard_map` over which one of the others does."""
    varying = [k for k in others if _varying(k)]
    return kind.update_manual_axis_type(varying[0].manual_axis_type) if varying else kind
