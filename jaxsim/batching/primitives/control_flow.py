"""`scan` and `cond` with lanes last: the same control flow with batched bodies."""

from jax import lax

from jaxsim.batching import divergence, forms
from jaxsim.batching.primitives.operands import all_as, select_lanes
from jaxsim.batching.registry import register


def scan(lanes, eqn, values, flags):
    """A `scan`; carried values that are the same for all lanes stay unbatched."""
    form = forms.read(eqn)
    if form is None:
        return None
    first, last = form.num_consts, form.num_consts + form.num_carry
    out = divergence.scan_flags(form, list(flags))
    carry_flags = out[: form.num_carry]
    consts, xs = values[:first], values[last:]
    body_flags = [*flags[:first], *carry_flags, *flags[last:]]

    def body(carry, x):
        results = lanes.evaluate_as(form.body, [*consts, *carry, *x], body_flags, out)
        return results[: form.num_carry], results[form.num_carry :]

    carry = all_as(lanes, values[first:last], flags[first:last], carry_flags)
    carry, ys = lax.scan(body, carry, list(xs), **form.options)
    return [*carry, *ys]


def cond(lanes, eqn, values, flags):
    """A `cond`: with an index for each lane, all branches are computed and one is selected."""
    form = forms.read(eqn)
    if form is None:
        return None
    index, *operands = values
    on = flags[1:]
    if flags[0]:
        cases = [lanes.evaluate_full(b, operands, on) for b in form.branches]
        return [select_lanes(index, column) for column in zip(*cases, strict=True)]
    out = divergence.cond_flags(form, on)

    def branch(program):
        return lambda *xs: lanes.evaluate_as(program, xs, on, out)

    cases = [branch(b) for b in form.branches]
    if form.platforms is None:
        return lax.switch(index, cases, *operands)
    named = zip(form.platforms, cases, strict=True)
    every = {name: case for names, case in named for name in names or ("default",)}
    return lax.platform_dependent(*operands, **every)


def _read_scan(p):
    counts = (
        [len(group) for group in p["ft_in"].unpack()]
        if "ft_in" in p
        else [p["num_consts"], p["num_carry"]]
    )
    options = {k: p[k] for k in ("length", "reverse", "unroll")}
    return forms.Scan(forms.program(p["jaxpr"]), counts[0], counts[1], options)


def _read_cond(p):
    return forms.Cond(tuple(forms.program(b) for b in p["branches"]), p.get("branches_platforms"))


register("scan", rule=scan, read=_read_scan, bodies="jaxpr", in_section=True)
register("cond", rule=cond, read=_read_cond, bodies="branches", in_section=True)
register("platform_index", in_section=True)  # that `lax.platform_dependent` branches on
