"""`while`, lanes last: it runs as long as any lane wants to, in the end with those lanes alone."""

import dataclasses
import functools

import jax.numpy as jnp
from jax import lax

from jaxsim.arrays import tuning
from jaxsim.batching import divergence, forms, jaxprs
from jaxsim.batching.primitives.operands import all_as, select_lanes
from jaxsim.batching.registry import register


def while_(lanes, eqn, values, flags):
    """Runs while any lane wants to; a lane that does not keeps its values.

    When few lanes are left the loop is compacted: they are gathered, and the rest of it costs what
    they cost.
    """
    form = forms.read(eqn)
    if form is None:
        return None
    first = form.num_cond_consts + form.num_body_consts
    carry_flags, diverges = divergence.while_flags(form, list(flags))
    consts = list(values[:first])
    carry = all_as(lanes, values[first:], flags[first:], carry_flags)
    loop = _Loop(form, list(flags[:first]), carry_flags)
    if not diverges:
        return loop.run_together(lanes, consts, carry)
    width = _compacted_width(lanes.size, form.body)
    if not width:
        return loop.run(lanes, consts, carry, 0)[1]
    active, carry = loop.run(lanes, consts, carry, width)
    return lax.cond(
        jnp.any(active),
        functools.partial(_run_compacted, lanes, loop, width),
        lambda active, _, carry: carry,
        active,
        consts,
        carry,
    )


def _compacted_width(size: int, body: forms.Program) -> int:
    """With how many of the lanes the loop goes on when no more are active; 0 if it does not pay."""
    width = max(size // tuning.COMPACTION_DIVISOR, tuning.COMPACTION_MIN)
    is_long = jaxprs.length(body.jaxpr.eqns) >= tuning.COMPACTION_BODY
    return width if is_long and width * tuning.COMPACTION_GAIN <= size else 0


@dataclasses.dataclass(frozen=True)
class _Loop:
    """A `while` for any number of lanes.

    Attributes:
      form: the equation.
      const_flags: which constants are batched, those of the condition first.
      carry_flags: which carried values are batched.
    """

    form: forms.While
    const_flags: divergence.Flags
    carry_flags: divergence.Flags

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
                select_lanes(active, [old, n]) if on else n
                for n, old, on in zip(
                    self.body(lanes, consts, carry), carry, self.carry_flags, strict=True
                )
            ]
            return self.wants(lanes, consts, new), new

        start = self.wants(lanes, consts, carry), carry
        if until == 0:
            return lax.while_loop(lambda state: jnp.any(state[0]), step, start)
        return lax.while_loop(lambda state: jnp.sum(state[0]) > until, step, start)


def _run_compacted(lanes, loop: _Loop, width: int, active, consts, carry) -> list:
    """The rest of a loop in which at most `width` lanes are active, with only so many lanes."""
    slot = jnp.where(active, jnp.cumsum(active) - 1, width)
    lane = lax.iota(slot.dtype, lanes.size)
    # Slots that are left over repeat lane 0, and nobody looks at them. No scatter, which could
    # not be part of a section.
    here = slot[None, :] == jnp.arange(width, dtype=slot.dtype)[:, None]
    chosen = jnp.sum(jnp.where(here, lane[None, :], 0), axis=1, dtype=slot.dtype)

    def take(values, flags):
        return [_gather_lanes(v, chosen) if on else v for v, on in zip(values, flags, strict=True)]

    fewer = dataclasses.replace(lanes, size=width)
    _, new = loop.run(fewer, take(consts, loop.const_flags), take(carry, loop.carry_flags), 0)
    return [
        select_lanes(active, [old, _gather_lanes(n, slot)]) if on else n
        for n, old, on in zip(new, carry, loop.carry_flags, strict=True)
    ]


def _gather_lanes(x, index):
    """Chosen lanes of x. With all other axes as one, XLA copies half as much."""
    rows = x.reshape(-1, x.shape[-1])
    return jnp.take(rows, index, axis=1, mode="clip").reshape(*x.shape[:-1], len(index))


def _read_while(p):
    cond = forms.program(p["cond_jaxpr"])
    if cond.jaxpr.outvars[0].aval.shape:  # the loop of a `jax.vmap`, which stops element by element
        return None
    return forms.While(cond, forms.program(p["body_jaxpr"]), p["cond_nconsts"], p["body_nconsts"])


register("while", rule=while_, read=_read_while, bodies="body_jaxpr", in_section=True)
