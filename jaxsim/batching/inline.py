"""Programs written out: the equations of calls in their place, for a CPU.

A call that stays one is a boundary for the compiler and for sections. What only JAX's derivatives
and batches need of it, rules and alternatives for other platforms, has done its work here.
"""

import functools
from collections.abc import Sequence

import jax
from jax import lax
from jax.extend import core as jex

from jaxsim.batching import forms, jaxprs
from jaxsim.batching.primitives.own_kernel import own_kernel_p


def inlined(jaxpr, fixed: int):
    """The program with the equations of its calls in their place, loops included.

    Its first `fixed` operands are those that a loop around it does not change.
    """
    eqns, invariant = [], {*jaxpr.constvars, *jaxpr.invars[:fixed]}

    def emit(eqn):
        invariant.update(_invariant_results(eqn, invariant))
        eqns.append(eqn)

    def inline(inner, known):
        def new(atom):
            return atom if isinstance(atom, jex.Literal) else known.get(atom, atom)

        for eqn in inner.eqns:
            operands = [new(v) for v in eqn.invars]
            barriers, operands = _apart(eqn, operands, invariant)
            eqns.extend(barriers)
            call = _inlined_call(eqn, operands)
            if call is None:
                made = [v if isinstance(v, jex.DropVar) else jex.Var(v.aval) for v in eqn.outvars]
                eqn = jaxprs.with_bodies(
                    eqn, functools.partial(inlined, fixed=num_invariant_operands(eqn))
                )
                emit(eqn.replace(invars=operands, outvars=made))
            else:
                body, given = call
                made = inline(body, dict(zip(body.invars, given, strict=True)))
            known.update(zip(eqn.outvars, made, strict=True))
        return [new(v) for v in inner.outvars]

    return jaxpr.replace(outvars=inline(jaxpr, {}), eqns=eqns)


def _inlined_call(eqn, operands: Sequence):
    """The program of a call that need not stay one, and its operands; else None."""
    if eqn.effects or eqn.ctx.xla_metadata or eqn.primitive is own_kernel_p:
        return None
    form = forms.read(eqn)
    branch = forms.platform_branch(form, "cpu")
    if branch is not None:
        body, given = branch, operands[1:]
    elif isinstance(form, forms.LinearSolve):  # derivatives have been taken
        count, first = sum(form.counts.values()), form.counts["matvec"] + form.counts["vecmat"]
        own = operands[first : first + form.counts["solve"]]
        body, given = form.parts["solve"], [*own, *operands[count:]]
    elif isinstance(form, forms.Jit | forms.Custom | forms.Remat):
        body, given = form.body, operands
    else:
        return None
    return None if body is None or body.consts else (body.jaxpr, given)


def _apart(eqn, operands: Sequence, invariant: set) -> tuple[list, Sequence]:
    """Operands, hidden where a backward pass must not take them from the forward pass, and how.

    Loop-invariant ones are left: what is computed of them is taken out of the loop.
    """
    form = forms.read(eqn)
    apart = form.apart if isinstance(form, forms.Remat) else ()
    hidden = dict.fromkeys(v for v in variables([operands[i] for i in apart]) if v not in invariant)
    if not hidden:
        return [], operands
    traced = jax.make_jaxpr(lax.optimization_barrier)([v.aval for v in hidden])
    made = {v: jex.Var(v.aval) for v in hidden}
    (barrier,) = traced.eqns
    barrier = barrier.replace(invars=[*made], outvars=[*made.values()])
    return [barrier], [v if isinstance(v, jex.Literal) else made.get(v, v) for v in operands]


def without_dead_code(jaxpr):
    """The program without the equations that nobody needs, which a section would keep."""
    needed, eqns = set(variables(jaxpr.outvars)), []
    for eqn in reversed(jaxpr.eqns):
        if eqn.effects or not needed.isdisjoint(eqn.outvars):
            eqns.append(eqn)
            needed.update(variables(eqn.invars))
    return jaxpr.replace(eqns=eqns[::-1])


def loop_invariant(jaxpr, fixed: int) -> set:
    """Variables that do not depend on operands other than the first `fixed`."""
    invariant = {*jaxpr.constvars, *jaxpr.invars[:fixed]}
    for eqn in jaxpr.eqns:
        invariant.update(_invariant_results(eqn, invariant))
    return invariant


def _invariant_results(eqn, invariant: set) -> Sequence:
    return eqn.outvars if not eqn.effects and invariant.issuperset(variables(eqn.invars)) else ()


def num_invariant_operands(eqn) -> int:
    """How many operands of its body a loop does not change."""
    match forms.read(eqn):
        case forms.Scan(num_consts=fixed) | forms.While(num_body_consts=fixed):
            return fixed
    return 0


def variables(atoms: Sequence) -> list:
    """Those of an equation's operands or results that are no literals."""
    return [v for v in atoms if isinstance(v, jex.Var)]
