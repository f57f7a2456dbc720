"""Calls of programs, lanes last: of jitted functions and of `jax.checkpoint`."""

import functools

import jax

from jaxsim.arrays import tuning
from jaxsim.batching import divergence, forms, jaxprs
from jaxsim.batching.registry import register


def jit(lanes, eqn, values, flags):
    """A call of a jitted function: small ones are inlined, large ones stay calls, traced once."""
    form = forms.read(eqn)
    if form is None:
        return None
    if len(form.body.jaxpr.eqns) < tuning.INLINED_EQUATIONS or form.body.consts:
        return lanes.evaluate(form.body, values, flags)[0]
    return _jitted(lanes, form.body.jaxpr, tuple(flags), form.name)(*values)


@functools.lru_cache(maxsize=256)
def _jitted(lanes, jaxpr, flags, name):
    def call(*values):
        return lanes.evaluate(forms.Program(jaxpr, ()), values, flags)[0]

    call.__name__ = name
    return jax.jit(call)


def remat(lanes, eqn, values, flags):
    """The same primitive with the batched body, so that the same values are recomputed."""
    form = forms.read(eqn)
    if form is None:
        return None
    out = divergence.program_flags(form.body, flags)
    traced = jax.make_jaxpr(lambda *xs: lanes.evaluate_as(form.body, xs, flags, out))(*values)
    jaxpr, consts = jaxprs.open_program(traced)
    options = {**eqn.params, "jaxpr": jaxpr}
    if not isinstance(options.get("prevent_cse", True), bool):
        options["prevent_cse"] = (True,) * len(consts) + tuple(options["prevent_cse"])
    return eqn.primitive.bind(*consts, *values, **options)


def _read_remat(p):
    body, flags = forms.program(p["jaxpr"]), p["prevent_cse"]
    if isinstance(flags, bool):
        flags = (flags,) * len(body.jaxpr.invars)
    hidden = tuple(i for i, flag in enumerate(flags) if flag and p["differentiated"])
    return forms.Remat(body, hidden)


def _body(parameter: str):
    return lambda p: forms.Jit(forms.program(p[parameter]), p.get("name", "closed_call"))


register("jit", "pjit", rule=jit, read=_body("jaxpr"), in_section=True)
register("closed_call", rule=jit, read=_body("call_jaxpr"), in_section=True)
register("remat2", "checkpoint", rule=remat, read=_read_remat)
