"""Divergence analysis: which values of a program depend on the lane.

A forward pass over the equations gives each value a flag. A result is batched if an operand is.
Loops are iterated to a fixed point, so that a counter or a table carried through `scan` stays one
value for all lanes.
"""

from collections.abc import Sequence

from jax.extend import core as jex

from jaxsim.batching import forms, registry

Flags = list[bool]


def program_flags(program: forms.Program, flags: Sequence[bool]) -> Flags:
    """Flags of a program's results, from those of its operands."""
    jaxpr = program.jaxpr
    env = dict(zip(jaxpr.invars, flags, strict=True))

    def look_up(atom):
        return not isinstance(atom, jex.Literal) and env.get(atom, False)

    for eqn in jaxpr.eqns:
        out = equation_flags(eqn, [look_up(v) for v in eqn.invars])
        env.update(zip(eqn.outvars, out, strict=True))
    return [look_up(v) for v in jaxpr.outvars]


def equation_flags(eqn, flags: Sequence[bool]) -> Flags:
    """Flags of an equation's results, from those of its operands."""
    flags = list(flags)
    if not any(flags) or registry.find(eqn).uniform:
        return [False] * len(eqn.outvars)
    match forms.read(eqn):
        case forms.Scan() as form:
            return scan_flags(form, flags)
        case forms.While() as form:
            return while_flags(form, flags)[0]
        case forms.Cond() as form if not flags[0]:
            return cond_flags(form, flags[1:])
        case forms.Jit(body=body) | forms.Remat(body=body):
            return program_flags(body, flags)
        case _:
            return [True] * len(eqn.outvars)


def scan_flags(form: forms.Scan, flags: Flags) -> Flags:
    """Flags of (carry, scanned results): the smallest fixed point of the body."""
    first, last = form.num_consts, form.num_consts + form.num_carry
    consts, carry, xs = flags[:first], flags[first:last], flags[last:]
    while True:
        out = program_flags(form.body, consts + carry + xs)
        grown = _union(carry, out)
        if grown == carry:
            return carry + out[form.num_carry :]
        carry = grown


def while_flags(form: forms.While, flags: Flags) -> tuple[Flags, bool]:
    """Flags of the carry, the smallest fixed point, and whether the condition depends on the lane.

    If it does, lanes stop at different times, and everything that the body changes is batched.
    """
    first, last = form.num_cond_consts, form.num_cond_consts + form.num_body_consts
    cond_consts, body_consts, carry = flags[:first], flags[first:last], flags[last:]
    body = form.body.jaxpr
    changed = [o is not i for o, i in zip(body.outvars, body.invars[last - first :], strict=True)]
    while True:
        (predicate,) = program_flags(form.cond, cond_consts + carry)
        grown = _union(carry, program_flags(form.body, body_consts + carry))
        if predicate:
            grown = _union(grown, changed)
        if grown == carry:
            return carry, predicate
        carry = grown


def cond_flags(form: forms.Cond, flags: Flags) -> Flags:
    """Flags of the results of a `cond` whose index is the same for all lanes."""
    out = [program_flags(branch, flags) for branch in form.branches]
    return [any(column) for column in zip(*out, strict=True)]


def _union(a: Sequence[bool], b: Sequence[bool]) -> Flags:
    return [x or y for x, y in zip(a, b, strict=False)]
