"""Tools for jaxprs, equations and types that do not depend on `forms`."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend import core as jex

from jaxsim.batching import registry


def is_divided(sharding) -> bool:
    """Whether a sharding (or None) divides any axis.

    Within `jax.shard_map`, JAX also attaches shardings that divide none.
    """
    return any(axis is not None for axis in getattr(sharding, "spec", ()))


def rebind(eqn) -> Callable:
    """The equation as a function of all its operands, with its custom rules."""
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
    """Number of equations, including those of called and inner programs."""
    return sum(1 + sum(length(jaxpr.eqns) for jaxpr in bodies(eqn)) for eqn in eqns)


def num_scalars(eqns: Sequence) -> int:
    """Number of scalars computed by equations, those of inner programs counted once."""
    return sum(
        sum(math.prod(v.aval.shape) for v in eqn.outvars)
        + sum(num_scalars(jaxpr.eqns) for jaxpr in bodies(eqn))
        for eqn in eqns
    )


def has_keys(eqns: Sequence) -> bool:
    """Whether equations, or those of inner programs, make random keys."""
    return any(
        any(jnp.issubdtype(v.aval.dtype, jax.dtypes.prng_key) for v in eqn.outvars)
        or any(has_keys(jaxpr.eqns) for jaxpr in bodies(eqn))
        for eqn in eqns
    )


def with_bodies(eqn, change: Callable):
    """The equation with `change` applied to bodies of loops and branches, not to conditions.

    `change` maps an open jaxpr to one with the same operands and results.
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
    """A closed jaxpr with `change` applied to its open jaxpr; jax 0.12 has one type for both."""
    if isinstance(jaxpr, jex.Jaxpr):
        return change(jaxpr)
    return jaxpr.replace(jaxpr=change(jaxpr.jaxpr))


def closed(invars, outvars, eqns):
    """A closed jaxpr of equations without effects."""
    return jex.ClosedJaxpr(_jaxpr(invars, outvars, eqns, frozenset()), ())


def open_program(traced) -> tuple[Any, tuple]:
    """The jaxpr with its constants as first operands, and the constants."""
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
    """An array, or its type, with the type of one element of a value along `axis`.

    With axis None, it has the type of the value. Inside `shard_map`, the type includes the mesh
    axes over which the value varies, and only a slice of the value has all of these.
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
    """Type of the result of f, from the types of its operands."""
    (result,) = jax.make_jaxpr(f)(
        *[jax.ShapeDtypeStruct(k.shape, k.dtype) for k in kinds]
    ).out_avals
    return varying_like(result, *kinds)


def varying_like(kind, *others):
    """The type, varying over all mesh axes of `shard_map` over which one of the others varies."""
    varying = [k for k in others if _varying(k)]
    return kind.update_manual_axis_type(varying[0].manual_axis_type) if varying else kind
