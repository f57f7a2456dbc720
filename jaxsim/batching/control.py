"""Loops, branches and nested calls, lanes last: the body is evaluated, its structure is kept."""

import dataclasses
import functools

import jax
import jax.numpy as jnp
from jax import lax

from jaxsim.batching import flow, params

# When only an eighth of the lanes wants to, or so few, a long loop goes on with those alone. Twice
# as many, 32 of 128, take longer: LLVM unrolls loops over so few before it makes vectors of them.
FEW, MIN_FEW = 8, 16
MIN_GAIN = 4  # times fewer lanes repay the change
LONG = 300  # equations of a body that repays the change
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
    """Runs while any lane wants to; a lane that does not keeps its values.

    When few lanes are left they are gathered, so that the rest of the loop costs what they cost.
    """
    form = params.read(eqn)
    if form is None:
        return None
    first = form.num_cond_consts + form.num_body_consts
    carry_flags, frozen = flow.while_flags(form, list(flags))
    consts = list(values[:first])
    carry = _raise(lanes, values[first:], flags[first:], carry_flags)
    loop = _Loop(form, list(flags[:first]), carry_flags)
    if not frozen:
        return loop.run_together(lanes, consts, carry)
    few = max(lanes.size // FEW, MIN_FEW)
    if few * MIN_GAIN > lanes.size or params.length(form.body.jaxpr.eqns) < LONG:
        return loop.run(lanes, consts, carry, 0)[1]
    active, carry = loop.run(lanes, consts, carry, few)
    return lax.cond(
        jnp.any(active),
        functools.partial(_go_on, lanes, loop, few),
        lambda active, _, carry: carry,
        active,
        consts,
        carry,
    )


@dataclasses.dataclass(frozen=True)
class _Loop:
    """A `while` for any number of lanes.

    Attributes:
      form: the equation.
      const_flags: which constants are batched, those of the condition first.
      carry_flags: which carried values are batched.
    """

    form: params.While
    const_flags: flow.Flags
    carry_flags: flow.Flags

    def wants(self, lanes, consts, carry):
        """Whether to go on, for all lanes together or for each."""
        count = self.form.num_cond_consts
        flags = [*self.const_flags[:count], *self.carry_flags]
        return lanes.evaluate(self.form.cond, [*consts[:count], *carry], flags)[0][0]

    def body(self, lanes, consts, carry):
        """One turn of every lane."""
        count = self.form.num_cond_consts
        flags = [*self.const_flags[count:], *self.carry_flags]
        return lanes.evaluate_as(self.form.body, [*consts[count:], *carry], flags, self.carry_flags)

    def run_together(self, lanes, consts, carry) -> list:
        """All lanes stop at the same time."""
        return lax.while_loop(
            lambda c: self.wants(lanes, consts, c), lambda c: self.body(lanes, consts, c), carry
        )

    def run(self, lanes, consts, carry, until: int):
        """Until at most so many lanes want to go on; also returns which these are."""

        def step(state):
            active, carry = state
            new = [
                _select(active, [old, n]) if on else n
                for n, old, on in zip(
                    self.body(lanes, consts, carry), carry, self.carry_flags, strict=True
                )
            ]
            return self.wants(lanes, consts, new), new

        start = self.wants(lanes, consts, carry), carry
        if until == 0:
            return lax.while_loop(lambda state: jnp.any(state[0]), step, start)
        return lax.while_loop(lambda state: jnp.sum(state[0]) > until, step, start)


def _go_on(lanes, loop: _Loop, few: int, active, consts, carry) -> list:
    """The rest of a loop in which at most `few` lanes are active, with only so many lanes."""
    place = jnp.where(active, jnp.cumsum(active) - 1, few)
    lane = lax.iota(place.dtype, lanes.size)
    # Places that are left over repeat lane 0, and nobody looks at them. No scatter, which could
    # not be part of a section.
    here = place[None, :] == jnp.arange(few, dtype=place.dtype)[:, None]
    chosen = jnp.sum(jnp.where(here, lane[None, :], 0), axis=1, dtype=place.dtype)

    def take(values, flags):
        return [_lanes(v, chosen) if on else v for v, on in zip(values, flags, strict=True)]

    fewer = dataclasses.replace(lanes, size=few)
    _, new = loop.run(fewer, take(consts, loop.const_flags), take(carry, loop.carry_flags), 0)
    return [
        _select(active, [old, _lanes(n, place)]) if on else n
        for n, old, on in zip(new, carry, loop.carry_flags, strict=True)
    ]


def _lanes(x, index):
    """Chosen lanes of x. With all other axes as one, XLA copies half as much."""
    rows = x.reshape(-1, x.shape[-1])
    return jnp.take(rows, index, axis=1, mode="clip").reshape(*x.shape[:-1], len(index))


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

    cases = [branch(b) for b in form.branches]
    if form.platforms is None:
        return lax.switch(index, cases, *operands)
    named = zip(form.platforms, cases, strict=True)
    every = {name: case for names, case in named for name in names or ("default",)}
    return lax.platform_dependent(*operands, **every)


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
    **dict.fromkeys(("jit", "pjit", "closed_call", "own_kernel"), jit),
    "scan": scan,
    "while": while_,
    "cond": cond,
    **dict.fromkeys(("remat2", "checkpoint"), remat),
}
