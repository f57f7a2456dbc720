"""`while` with lanes last: it runs while any lane is active, in the end with these lanes only."""

import dataclasses
import functools

import jax.numpy as jnp
from jax import lax

from jaxsim.arrays import tuning
from jaxsim.batching import divergence, forms, jaxprs
from jaxsim.batching.primitives.operands import all_as, select_lanes
from jaxsim.batching.registry import register


def while_(lanes, eqn, values, flags):
    """A `while` that runs while any lane is active; other lanes keep their values.

    When few lanes are active, the loop is compacted: these lanes are gathered into a smaller batch
    for the remaining iterations.
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
    """Number of lanes of the compacted loop; 0 if compaction does not pay."""
    width = max(size // tuning.COMPACTION_DIVISOR, tuning.COMPACTION_MIN)
    is_long = jaxprs.length(body.jaxpr.eqns) >= tuning.COMPACTION_BODY
    return width if is_long and width * tuning.COMPACTION_GAIN <= size else 0


@dataclasses.dataclass(frozen=True)
class _Loop:
    """A `while` for any number of lanes.

    Attributes:
      form: the equation.
      const_flags: whether each constant is batched, those of the condition first.
      carry_flags: whether each carried value is batched.
    """

    form: forms.While
    const_flags: divergence.Flags
    carry_flags: divergence.Flags

    def wants(self, lanes, consts, carry):
        """The condition, for all lanes together or for each lane."""
        count = self.form.num_cond_consts
        flags = [*self.const_flags[:count], *self.carry_flags]
        return lanes.evaluate(self.form.cond, [*consts[:count], *carry], flags)[0][0]

    def body(self, lanes, consts, carry):
        """One iteration of all lanes."""
        count = self.form.num_cond_consts
        flags = [*self.const_flags[count:], *self.carry_flags]
        return lanes.evaluate_as(self.form.body, [*consts[count:], *carry], flags, self.carry_flags)

    def run_together(self, lanes, consts, carry) -> list:
        """Run a loop whose condition is the same for all lanes."""
        return lax.while_loop(
            lambda c: self.wants(lanes, consts, c), lambda c: self.body(lanes, consts, c), carry
        )

    def run(self, lanes, consts, carry, until: int):
        """Run until at most `until` lanes are active; also returns a mask of these."""

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
    """The rest of a loop with at most `width` active lanes, as a loop over `width` lanes."""
    slot = jnp.where(active, jnp.cumsum(active) - 1, width)
    lane = lax.iota(slot.dtype, lanes.size)
    # Unused slots repeat lane 0 and are ignored. Results are gathered, not scattered, because a
    # scatter cannot be part of a section.
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
    """Gather lanes of x. All other axes are merged, because XLA then copies half as much."""
    rows = x.reshape(-1, x.shape[-1])
    return jnp.take(rows, index, axis=1, mode="clip").reshape(*x.shape[:-1], len(index))


def _read_while(p):
    cond = forms.program(p["cond_jaxpr"])
    if cond.jaxpr.outvars[0].aval.shape:  # the loop of a `jax.vmap`, which stops element by element
        return None
    return forms.While(cond, forms.program(p["body_jaxpr"]), p["cond_nconsts"], p["body_nconsts"])


register("while", rule=while_, read=_read_while, bodies="body_jaxpr", in_section=True)
