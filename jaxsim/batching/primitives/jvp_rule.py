"""Functions with a custom forward derivative, which they keep inside loops.

`jax.custom_jvp` also attaches such a rule. But for reverse mode JAX splits the body of a `lax.scan`
into a known and an unknown part, and the known part then has the equations of the function's body
without the rule, so that a second derivative is that of the body. A primitive is not split and
keeps its rule.
"""

from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.numpy as jnp
from jax.extend import core as jex
from jax.interpreters import ad, batching, mlir

from jaxsim.batching import jaxprs

Rule = Callable[[Sequence, Sequence], tuple[Sequence, Sequence]]
"""From operands and their tangents to results and theirs; a tangent that is zero is None."""


def with_jvp_rule(f: Callable, rule: Rule) -> Callable:
    """Return `f`, a function of arrays to a list of arrays, with another forward derivative.

    If it is applied to tangents, its transpose is that of `f`. It costs nothing at run time.

    Args:
      f: the function; it must not close over traced values.
      rule: its derivative, from primals and tangents to results and their tangents. For a second
        derivative the rule is differentiated, so it must compute the function's results by
        calling the function returned here.
    """

    def call(*xs):
        program = jax.make_jaxpr(f)(*[jaxprs.element(x, None) for x in xs])
        return jvp_rule_p.bind(*xs, program=program, rule=rule)

    return call


def moving_leaves(
    tree: Any, tangents: Sequence[Any]
) -> tuple[list[Any], list[Any], Callable[..., Any]]:
    """The part of a rule's operands that has tangents.

    Args:
      tree: operands of the rule.
      tangents: one for each leaf, None where it is zero.

    Returns:
      The leaves that have tangents, these tangents, and a function from other values of these
      leaves to the tree.
    """
    leaves, structure = jax.tree.flatten(tree)
    moving = [t is not None for t in tangents]

    def with_leaves(*values):
        rest = iter(values)
        return structure.unflatten(
            [next(rest) if m else x for x, m in zip(leaves, moving, strict=True)]
        )

    moved, given = ([x for x, m in zip(xs, moving, strict=True) if m] for xs in (leaves, tangents))
    return moved, given, with_leaves


def _evaluate(*xs, program, rule):
    del rule
    return jex.jaxpr_as_fun(program)(*xs)


def _types(*kinds, program, rule):
    del rule
    return [jaxprs.varying_like(kind, *kinds) for kind in program.out_avals]


def _jvp(primals, tangents, *, program, rule):
    del program
    given = [None if type(t) is ad.Zero else t for t in tangents]
    results, dots = rule(primals, given)
    zeros = [ad.Zero(jax.typeof(x).to_tangent_aval()) for x in results]
    return results, [z if d is None else d for z, d in zip(zeros, dots, strict=True)]


def _transpose(cotangents, *xs, program, rule):
    del rule
    linear = [ad.is_undefined_primal(x) for x in xs]

    def f(*some):
        rest = iter(some)
        operands = [next(rest) if on else x for x, on in zip(xs, linear, strict=True)]
        return jex.jaxpr_as_fun(program)(*operands)

    kinds = [x.aval for x, on in zip(xs, linear, strict=True) if on]
    results = zip(cotangents, program.out_avals, strict=True)
    given = [jnp.zeros(a.shape, a.dtype) if type(c) is ad.Zero else c for c, a in results]
    found = iter(jax.linear_transpose(f, *kinds)(given))
    return [next(found) if on else None for on in linear]


def _batch(values, axes, *, program, rule):
    """`jax.vmap` of the function and of its rule, batch first."""
    size = next(x.shape[a] for x, a in zip(values, axes, strict=True) if a is not None)

    def every(f: Callable, axes: Any):
        return jax.vmap(f, axes, axis_size=size)

    def batched_rule(primals, tangents):
        moving = [axis if t is not None else None for t, axis in zip(tangents, axes, strict=True)]
        return every(rule, (list(axes), moving))(list(primals), list(tangents))

    f = every(jex.jaxpr_as_fun(program), axes)
    results = with_jvp_rule(f, batched_rule)(*values)
    return results, [0] * len(results)


jvp_rule_p = jex.Primitive("jvp_rule")
jvp_rule_p.multiple_results = True
jvp_rule_p.def_impl(_evaluate)
jvp_rule_p.def_abstract_eval(_types)
ad.primitive_jvps[jvp_rule_p] = _jvp
ad.primitive_transposes[jvp_rule_p] = _transpose
batching.primitive_batchers[jvp_rule_p] = _batch
mlir.register_lowering(jvp_rule_p, mlir.lower_fun(_evaluate, multiple_results=True))
