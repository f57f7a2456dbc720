"""Loops, branches and nested calls, lanes last: the body is evaluated, its structure is kept."""

import functools

import jax
import jax.numpy as jnp
from jax import lax

from jaxsim.batch import flow, params

INLINE = 16  # a jitted function of fewer equations becomes part of its caller


def jit(lanes, eqn, values, flags):
    """Large functions stay functions: traced once for all calls, compiled once for eager ones."""
    form = params.read(eqn)
    if form is None:
        return None
    if len(form.body.jaxpr.eqns) < INLINE or form.body.consts:
        return lanes.evaluate(form.body, values, flags)[0]
    return _jitted(lanes, form.body.jaxpr, tuple(flags), form.name)(*values)


@functools.lru_cache(maxsize=256)
def _jitted(lanes, jaxpr, flags, name):
    def call(*values):
        return lanes.evaluate(params.Program(jaxpr, ()), values, flags)[0]

    call.__name__ = name
    return jax.jit(call)


def scan(lanes, eqn, values, flags):
    """Carries that no lane changes by itself stay unbatched."""
    form = params.read(eqn)
    if form is None:
        return None
    first, last = form.num_consts, form.num_consts + form.num_carry
    out = flow.scan_flags(form, list(flags))
    carry_flags = out[: form.num_carry]
    consts, xs = values[:first], values[last:]
    body_flags = [*flags[:first], *carry_flags, *flags[last:]]

    def body(carry, x):
        results = lanes.evaluate_as(form.body, [*consts, *carry, *x], body_flags, out)
        return results[: form.num_carry], results[form.num_carry :]

    carry = _raise(lanes, values[first:last], flags[first:last], carry_flags)
    carry, ys = lax.scan(body, carry, list(xs), **form.options)
    return [*carry, *ys]


def while_(lanes, eqn, values, flags):
    """Runs while any lane wants to; a lane that does not keeps its values."""
    form = params.read(eqn)
    if form is None:
        return None
    first, last = form.num_cond_consts, form.num_cond_consts + form.num_body_consts
    carry_flags, frozen = flow.while_flags(form, list(flags))
    carry = _raise(lanes, values[last:], flags[last:], carry_flags)

    def wants(carry):
        operands = [*values[:first], *carry]
        return lanes.evaluate(form.cond, operands, [*flags[:first], *carry_flags])[0][0]

    def body(carry):
        operands, on = [*values[first:last], *carry], [*flags[first:last], *carry_flags]
        return lanes.evaluate_as(form.body, operands, on, carry_flags)

    if not frozen:
        return lax.while_loop(wants, body, carry)

    def step(state):
        active, carry = state
        new = [
            _select(active, [old, n]) if on else n
            for n, old, on in zip(body(carry), carry, carry_flags, strict=True)
        ]
        return wants(new), new

    return lax.while_loop(lambda state: jnp.any(state[0]), step, (wants(carry), carry))[1]


def cond(lanes, eqn, values, flags):
    """A shared index branches; with an index for each lane every branch runs, then selects."""
    form = params.read(eqn)
    if form is None:
        return None
    index, *operands = values
    on = flags[1:]
    if flags[0]:
        cases = [lanes.evaluate_full(b, operands, on) for b in form.branches]
        return [_select(index, column) for column in zip(*cases, strict=True)]
    out = flow.cond_flags(form, on)

    def branch(program):
        return lambda *xs: lanes.evaluate_as(program, xs, on, out)

    return lax.switch(index, [branch(b) for b in form.branches], *operands)


def remat(lanes, eqn, values, flags):
    """The same primitive around the batched body: what is recomputed, and when, is unchanged."""
    form = params.read(eqn)
    if form is None:
        return None
    out = flow.program_flags(form.body, flags)
    traced = jax.make_jaxpr(lambda *xs: lanes.evaluate_as(form.body, xs, flags, out))(*values)
    jaxpr, consts = params.open_program(traced)
    options = {**eqn.params, "jaxpr": jaxpr}
    if not isinstance(options.get("prevent_cse", True), bool):
        options["prevent_cse"] = (True,) * len(consts) + tuple(options["prevent_cse"])
    return eqn.primitive.bind(*consts, *values, **options)


def _raise(lanes, values, flags, wanted) -> list:
    """Give a lane axis to the values that the loop will batch."""
    return [lanes.materialise(v, f or not w) for v, f, w in zip(values, flags, wanted, strict=True)]


def _select(which, cases):
    """Choose by lane: `which` has the lane axis only."""
    which = lax.broadcast_in_dim(which, cases[0].shape, (cases[0].ndim - 1,))
    return lax.select_n(which, *cases)


RULES = {
    **dict.fromkeys(("jit", "pjit", "closed_call"), jit),
    "scan": scan,
    "while": while_,
    "cond": cond,
    **dict.fromkeys(("remat2", "checkpoint"), remat),
}
