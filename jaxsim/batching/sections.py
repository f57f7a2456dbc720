"""Division of programs into sections, each of which a CPU runs as one kernel.

On a CPU, XLA starts every fused operation separately, which for a few hundred lanes takes about as
long as the operation. But a call with the attribute `xla_cpu_small_call`, which XLA itself gives to
small loops, is compiled as one function. So the equations that such a function may contain are
outlined here into calls, with control flow if it is short enough. Other equations stay as they are,
and bodies of longer loops and branches are divided in the same way. A compiler that does not know
the attribute computes the same numbers more slowly.
"""

import collections
import functools
from collections.abc import Callable, Iterator, Sequence

import jax
import jax.numpy as jnp
from jax import lax
from jax.experimental.xla_metadata import set_xla_metadata
from jax.extend import core as jex
from jax.interpreters import mlir

from jaxsim.arrays import tuning
from jaxsim.batching import jaxprs, registry
from jaxsim.batching.concatenation import JOINING, with_parts_first
from jaxsim.batching.passes import (
    inlined,
    loop_invariant,
    num_invariant_operands,
    variables,
    without_dead_code,
)
from jaxsim.batching.primitives.own_kernel import not_inlined

PLAIN = "bool", "int8", "uint8", "int32", "uint32", "int64", "uint64", "float32", "float64"
VIEWS = "slice", "split", "squeeze", "unstack", "reshape", "expand_dims"  # of another array
REPEATING = "broadcast_in_dim", "iota"


def sectioned(f: Callable, platform: str) -> Callable:
    """Return `f` with its program divided into sections, if the platform is a CPU.

    The result has no derivatives, so this is the last transformation. It must be compiled with
    `parallel.devices.compiler_options`, which keep XLA's optimisation barriers.
    """
    if platform != "cpu":
        return f

    @functools.wraps(f)
    def divided(*args):
        leaves, tree = jax.tree.flatten(args)
        traced, shapes = jax.make_jaxpr(
            lambda *xs: f(*jax.tree.unflatten(tree, xs)), return_shape=True
        )(*leaves)
        program = jaxprs.with_jaxpr(traced, functools.partial(_divided, num_invariant=0))
        return jax.tree.unflatten(jax.tree.structure(shapes), jex.jaxpr_as_fun(program)(*leaves))

    return divided


def _divided(jaxpr, num_invariant: int):
    """The program divided into sections; its first `num_invariant` operands are loop-invariant."""
    jaxpr = without_dead_code(inlined(jaxpr, num_invariant))
    invariant = loop_invariant(jaxpr, num_invariant)
    groups = list(_groups(jaxpr.eqns, invariant))
    users = _users(jaxpr, [group for group, _ in groups])
    views = {v: eqn for eqn in jaxpr.eqns for v in eqn.outvars if v in invariant and _is_view(eqn)}
    eqns = []
    for index, (group, repays) in enumerate(groups):
        if not repays:
            eqns += map(_inner_divided, group)
            continue
        results = [v for eqn in group for v in eqn.outvars if users[v] - {index}]
        eqns.append(_section([*_needed(group, views), *group], results))
    return jaxpr.replace(eqns=eqns)


def _groups(eqns: Sequence, invariant: set) -> Iterator[tuple[list, bool]]:
    """Groups of equations, reordered within their dependences, and whether each is a section.

    Loop-invariant equations are in no section, so that XLA moves them out of the loop.
    """
    section, made, size = [], set(), 0
    for eqn in eqns:
        length = jaxprs.length([eqn])
        limit = tuning.SECTION_LOOP if eqn.primitive.name == "while" else tuning.SECTION_MAX
        joins = length <= limit and not invariant.issuperset(eqn.outvars) and _fits(eqn)
        full = joins and size + length > tuning.SECTION_MAX
        if section and (full or (not joins and not made.isdisjoint(variables(eqn.invars)))):
            yield section, size >= tuning.SECTION_MIN
            section, made, size = [], set(), 0
        if joins:
            section.append(eqn)
            made.update(eqn.outvars)
            size += length
        else:
            yield [eqn], False
    if section:
        yield section, size >= tuning.SECTION_MIN


def _users(jaxpr, groups: Sequence[Sequence]) -> dict:
    """For each variable the indices of the groups that read it; None stands for the results."""
    users = collections.defaultdict(set)
    for index, group in enumerate(groups):
        for eqn in group:
            for v in variables(eqn.invars):
                users[v].add(index)
    for v in variables(jaxpr.outvars):
        users[v].add(None)
    return users


def _is_view(eqn) -> bool:
    """Whether the equation is a view, such as a broadcast or slice, free for its reader."""
    return eqn.primitive.name in (*VIEWS, *REPEATING)


def _needed(group: Sequence, views: dict) -> list:
    """The views that the group reads, in order; outside of it, each would be a kernel."""
    found = {}

    def visit(eqn):
        for v in variables(eqn.invars):
            if v in views and id(views[v]) not in found:
                visit(views[v])
                found[id(views[v])] = views[v]

    for eqn in group:
        visit(eqn)
    return list(found.values())


def _fits(eqn) -> bool:
    """Whether the equation, with all its inner programs, can be part of a section."""
    if not registry.fits_section(eqn) or eqn.effects:
        return False
    if not all(_is_plain(v.aval) for v in (*eqn.invars, *eqn.outvars)):
        return False
    return all(_fits(inner) for jaxpr in jaxprs.bodies(eqn) for inner in jaxpr.eqns)


def _is_plain(kind) -> bool:
    """Whether the type is an array of booleans, or of numbers that need no emulation."""
    dtype = getattr(kind, "dtype", None)
    return getattr(dtype, "name", None) in PLAIN


def _inner_divided(eqn):
    """The equation; the bodies of a long loop or branch are divided into sections."""
    if eqn.effects or jaxprs.length([eqn]) < tuning.SECTION_MIN:
        return eqn
    return jaxprs.with_bodies(
        eqn, functools.partial(_divided, num_invariant=num_invariant_operands(eqn))
    )


def _section(eqns: Sequence, results: Sequence):
    """One equation that calls several equations as a section."""
    made = {v for eqn in eqns for v in eqn.outvars}
    read = dict.fromkeys(v for eqn in eqns for v in variables(eqn.invars) if v not in made)
    program = jaxprs.closed([*read], results, _parts_first(eqns))
    return jex.new_jaxpr_eqn([*read], results, section_p, {"program": program}, set())


def _parts_first(eqns: Sequence) -> list:
    """The equations, with the parts of concatenations computed before them."""
    made = {v for eqn in eqns if eqn.primitive.name not in (*VIEWS, *JOINING) for v in eqn.outvars}
    parts_first = lambda jaxpr: jaxpr.replace(eqns=_parts_first(jaxpr.eqns))  # noqa: E731
    new = []
    for eqn in eqns:
        if eqn.primitive.name in JOINING:
            eqn = with_parts_first(eqn, made)
        new.append(jaxprs.with_bodies(eqn, parts_first))
    return new


def _run(*values, program):
    """Call the section as one function; arrays without elements are not operands or results."""
    # XLA aborts if an operand of such a function is unused. So operands must not be constants,
    # which XLA would move into the function, and each is read even if its numbers are not needed.
    full = lax.optimization_barrier([x for x in values if x.size])

    def section(*xs):
        given = iter(xs)
        operands = [next(given) if x.size else jnp.zeros_like(x) for x in values]
        results = jex.jaxpr_as_fun(program)(*operands)
        return [*(x for x in results if x.size), sum(map(_touch, xs), jnp.int32(0))]

    (call,) = jax.make_jaxpr(jax.jit(section))(*full).eqns
    with not_inlined(), set_xla_metadata(xla_cpu_small_call="true"):
        results = iter(call.primitive.bind(*full, **call.params))
    return [next(results) if v.size else jnp.zeros(v.shape, v.dtype) for v in program.out_avals]


def _touch(x):
    """A number that depends on an element of x."""
    first = lax.squeeze(lax.slice(x, (0,) * x.ndim, (1,) * x.ndim), range(x.ndim))
    return lax.ne(first, lax.full_like(first, 0)).astype(jnp.int32)


section_p = jex.Primitive("section")
section_p.multiple_results = True
section_p.def_abstract_eval(lambda *_, program: program.out_avals)
mlir.register_lowering(section_p, mlir.lower_fun(_run, multiple_results=True))
