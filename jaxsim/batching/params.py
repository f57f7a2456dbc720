"""The parameters of JAX's higher-order primitives, read in this one place.

They are no public interface and their names move between releases (jax 0.12 renamed those
of `scan`), so every form is detected by its features, never by a version number. A form we
do not know reads as None: the caller then falls back to `jax.vmap` of that primitive, which
is slower and just as right, and `warn_unknown` says so once.
"""

import functools
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import jax
from jax import lax
from jax.extend import core as jex


@dataclass(frozen=True)
class Program:
    """A traced function: equations, and the constants it closed over."""

    jaxpr: Any
    consts: tuple


@dataclass(frozen=True)
class Scan:
    """`lax.scan`: operands are constants, then carry, then scanned arrays."""

    body: Program
    num_consts: int
    num_carry: int
    options: dict


@dataclass(frozen=True)
class While:
    """`lax.while_loop`: operands are the condition's constants, the body's, then the carry."""

    cond: Program
    body: Program
    num_cond_consts: int
    num_body_consts: int


@dataclass(frozen=True)
class Cond:
    """`lax.cond` and `lax.switch`: operands are the branch index, then the branches' own.

    With platforms, the names for each branch or None for the default, it is
    `lax.platform_dependent`, and the index that of the platform.
    """

    branches: tuple[Program, ...]
    platforms: tuple[tuple[str, ...] | None, ...] | None


@dataclass(frozen=True)
class Jit:
    """A call of a jitted function, which may be inlined."""

    body: Program
    name: str


@dataclass(frozen=True)
class Remat:
    """`jax.checkpoint`, before or after its differentiation.

    Attributes:
      body: the program.
      apart: operands that the backward pass must not take from the forward pass, so that it
        computes anew instead of keeping; none before differentiation.
    """

    body: Program
    apart: tuple[int, ...]


@dataclass(frozen=True)
class Custom:
    """A call of a function with a derivative of its own ("jvp" or "vjp")."""

    body: Program
    kind: str


@dataclass(frozen=True)
class LinearSolve:
    """`lax.custom_linear_solve`: operands are the constants of each program, then b.

    Attributes:
      parts: the programs by name; one that is missing has no constants and is None.
      counts: number of constants of each.
      replace: from new programs to the parameters of the primitive.
    """

    parts: dict[str, Program | None]
    counts: dict[str, int]
    replace: Callable[[dict], dict]


def program(jaxpr) -> Program:
    """Accept an open jaxpr, a closed one, or the one type that jax 0.12 has for both."""
    return Program(getattr(jaxpr, "jaxpr", jaxpr), tuple(getattr(jaxpr, "consts", ())))


def _scan(p):
    counts = (
        [len(group) for group in p["ft_in"].unpack()]
        if "ft_in" in p
        else [p["num_consts"], p["num_carry"]]
    )
    options = {k: p[k] for k in ("length", "reverse", "unroll")}
    return Scan(program(p["jaxpr"]), counts[0], counts[1], options)


def _while(p):
    cond = program(p["cond_jaxpr"])
    if cond.jaxpr.outvars[0].aval.shape:  # the loop of a `jax.vmap`, which stops element by element
        return None
    return While(cond, program(p["body_jaxpr"]), p["cond_nconsts"], p["body_nconsts"])


def _cond(p):
    return Cond(tuple(program(b) for b in p["branches"]), p.get("branches_platforms"))


def _remat(p):
    body, apart = program(p["jaxpr"]), p["prevent_cse"]
    if isinstance(apart, bool):
        apart = (apart,) * len(body.jaxpr.invars)
    return Remat(body, tuple(i for i, flag in enumerate(apart) if flag and p["differentiated"]))


def _linear_solve(p):
    kinds, counts = p["jaxprs"], p["const_lengths"]
    parts = {k: v if v is None else program(v) for k, v in kinds._asdict().items()}
    replace = lambda new: {**p, "jaxprs": kinds._replace(**new)}  # noqa: E731
    return LinearSolve(parts, {k: getattr(counts, k) or 0 for k in parts}, replace)


_READERS: dict[str, Callable[[dict], Any]] = {
    "scan": _scan,
    "while": _while,
    "cond": _cond,
    "jit": lambda p: Jit(program(p["jaxpr"]), p["name"]),
    "pjit": lambda p: Jit(program(p["jaxpr"]), p["name"]),
    "closed_call": lambda p: Jit(program(p["call_jaxpr"]), "closed_call"),
    "own_kernel": lambda p: Jit(program(p["program"]), "own_kernel"),
    "remat2": _remat,
    "checkpoint": _remat,
    "custom_linear_solve": _linear_solve,
    "custom_jvp_call": lambda p: Custom(program(p["call_jaxpr"]), "jvp"),
    "jvp_rule": lambda p: Custom(program(p["program"]), "jvp"),
    "custom_vjp_call": lambda p: Custom(program(p["call_jaxpr"]), "vjp"),
}


def read(eqn):
    """The form of a higher-order equation, or None for an ordinary or an unknown one."""
    reader = _READERS.get(eqn.primitive.name)
    if reader is None:
        return None
    try:
        return reader(eqn.params)
    except (KeyError, AttributeError, TypeError, ValueError, IndexError):
        warn_unknown(eqn.primitive.name)
        return None


@functools.cache
def warn_unknown(name: str) -> None:
    """Say, once for each primitive, that its parameters were not understood."""
    warnings.warn(
        f"jaxsim.vmap does not know how this JAX release ({jax.__version__}) stores {name}; "
        "it uses jax.vmap for it, which is slower",
        stacklevel=2,
    )


def platform_branch(eqn, platform: str):
    """The index of the branch that a `lax.platform_dependent` takes, or None for all else."""
    platforms = eqn.params.get("branches_platforms") if eqn.primitive.name == "cond" else None
    fitting = (i for i, names in enumerate(platforms or ()) if names is None or platform in names)
    return next(fitting, None)


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
    name = {"scan": "jaxpr", "while": "body_jaxpr", "cond": "branches"}.get(eqn.primitive.name)
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
