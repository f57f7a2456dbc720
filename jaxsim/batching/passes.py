"""Passes over a traced program before it is divided: inlining, dead code, loop invariants.

A call that is not inlined is a boundary for the compiler and for sections. Custom derivatives and
branches for other platforms are not needed any more at this stage, so they are inlined, too.
"""

import functools
from collections.abc import Sequence

import jax
from jax import lax
from jax.extend import core as jex

from jaxsim.batching import forms, jaxprs
from jaxsim.batching.primitives.own_kernel import own_kernel_p


def inlined(jaxpr, num_invariant: int):
    """The program with calls inlined, also within loops.

    Its first `num_invariant` operands are invariant in the loop around it.
    """
    eqns, invariant = [], {*jaxpr.constvars, *jaxpr.invars[:num_invariant]}

    def emit(eqn):
        invariant.update(_invariant_results(eqn, invariant))
        eqns.append(eqn)

    def inline(inner, known):
        def new(atom):
            return atom if isinstance(atom, jex.Literal) else known.get(atom, atom)

        for eqn in inner.eqns:
            operands = [new(v) for v in eqn.invars]
            barriers, operands = _behind_barrier(eqn, operands, invariant)
            eqns.extend(barriers)
            call = _inlined_call(eqn, operands)
            if call is None:
                made = [v if isinstance(v, jex.DropVar) else jex.Var(v.aval) for v in eqn.outvars]
                eqn = jaxprs.with_bodies(
                    eqn, functools.partial(inlined, num_invariant=num_invariant_operands(eqn))
                )
                emit(eqn.replace(invars=operands, outvars=made))
            else:
                body, given = call
                made = inline(body, dict(zip(body.invars, given, strict=True)))
            known.update(zip(eqn.outvars, made, strict=True))
        return [new(v) for v in inner.outvars]

    return jaxpr.replace(outvars=inline(jaxpr, {}), eqns=eqns)


def _inlined_call(eqn, operands: Sequence):
    """The program and operands of a call that can be inlined; None for other equations."""
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


def _behind_barrier(eqn, operands: Sequence, invariant: set) -> tuple[list, Sequence]:
    """A barrier before a recomputing backward pass, if it needs one, and the new operands.

    Without it, XLA would merge the recomputation with the forward pass and store the values.
    Loop-invariant operands need no barrier, because computations with them are moved out of the
    loop.
    """
    form = forms.read(eqn)
    recomputing = form.prevent_cse if isinstance(form, forms.Remat) else ()
    candidates = variables([operands[i] for i in recomputing])
    hidden = dict.fromkeys(v for v in candidates if v not in invariant)
    if not hidden:
        return [], operands
    traced = jax.make_jaxpr(lax.optimization_barrier)([v.aval for v in hidden])
    made = {v: jex.Var(v.aval) for v in hidden}
    (barrier,) = traced.eqns
    barrier = barrier.replace(invars=[*made], outvars=[*made.values()])
    return [barrier], [v if isinstance(v, jex.Literal) else made.get(v, v) for v in operands]


def without_dead_code(jaxpr):
    """The program without dead equations, which a section would keep."""
    needed, eqns = set(variables(jaxpr.outvars)), []
    for eqn in reversed(jaxpr.eqns):
        if eqn.effects or not needed.isdisjoint(eqn.outvars):
            eqns.append(eqn)
            needed.update(variables(eqn.invars))
    return jaxpr.replace(eqns=eqns[::-1])


def loop_invariant(jaxpr, num_invariant: int) -> set:
    """Variables that do not depend on operands other than the first `num_invariant`."""
    invariant = {*jaxpr.constvars, *jaxpr.invars[:num_invariant]}
    for eqn in jaxpr.eqns:
        invariant.update(_invariant_results(eqn, invariant))
    return invariant


def _invariant_results(eqn, invariant: set) -> Sequence:
    return eqn.outvars if not eqn.effects and invariant.issuperset(variables(eqn.invars)) else ()


def num_invariant_operands(eqn) -> int:
    """Number of operands of a loop's body that are invariant."""
    match forms.read(eqn):
        case forms.Scan(num_consts=num_invariant) | forms.While(num_body_consts=num_invariant):
            return num_invariant
    return 0


def variables(atoms: Sequence) -> list:
    """The operands or results of an equation that are not literals."""
    return [v for v in atoms if isinstance(v, jex.Var)]
