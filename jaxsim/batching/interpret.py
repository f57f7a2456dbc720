"""Interpreter that evaluates a traced program for all lanes at once, with lanes on the last axis.

Every value is an array with a flag. Batched values have a trailing axis of `size` lanes, the
others do not. An equation without batched operands is evaluated as it is, one whose primitive has
a rule by the rule, and any other by `jax.vmap` of its primitive.
"""

import collections
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax
from jax import lax
from jax.extend import core as jex

from jaxsim.batching import divergence, forms, jaxprs, registry
from jaxsim.batching.lazy import Lazy


def force(value):
    """The array of a value, which is computed now if the value is lazy."""
    return value.force() if isinstance(value, Lazy) else value


def _atoms(jaxpr):
    """All operands of a program's equations, and its results."""
    yield from itertools.chain.from_iterable(eqn.invars for eqn in jaxpr.eqns)
    yield from jaxpr.outvars


@dataclass(frozen=True)
class Lanes:
    """A batch of `size` lanes; evaluates programs and functions over it."""

    size: int

    def broadcast(self, value, flag: bool):
        """The value with a lane axis, which is added if it has none."""
        if flag:
            return value
        shape = jax.numpy.shape(value)
        return lax.broadcast_in_dim(value, (*shape, self.size), range(len(shape)))

    def evaluate(
        self, program: forms.Program, values: Sequence, flags: Sequence[bool]
    ) -> tuple[list, list[bool]]:
        """Results of the program and their flags, the same as by `divergence.program_flags`."""
        jaxpr = program.jaxpr
        env = {v: (c, False) for v, c in zip(jaxpr.constvars, program.consts, strict=True)}
        env.update(zip(jaxpr.invars, zip(values, flags, strict=True), strict=True))

        def look_up(atom):
            return (atom.val, False) if isinstance(atom, jex.Literal) else env[atom]

        uses = collections.Counter(v for v in _atoms(jaxpr) if isinstance(v, jex.Var))
        for eqn in jaxpr.eqns:
            operands = [look_up(v) for v in eqn.invars]
            xs, on = [v for v, _ in operands], [f for _, f in operands]
            xs = [x if isinstance(x, registry.find(eqn).takes) else force(x) for x in xs]
            out = divergence.equation_flags(eqn, on)
            results = [
                x if uses[v] == 1 else force(x)
                for v, x in zip(eqn.outvars, self._equation(eqn, xs, on), strict=True)
            ]
            env.update(zip(eqn.outvars, zip(results, out, strict=True), strict=True))
        results = [look_up(v) for v in jaxpr.outvars]
        return [force(v) for v, _ in results], [f for _, f in results]

    def evaluate_as(self, program, values, flags, wanted: Sequence[bool]) -> list:
        """The results; those in `wanted` always have a lane axis."""
        results, out = self.evaluate(program, values, flags)
        return [self.broadcast(v, f or not w) for v, f, w in zip(results, out, wanted, strict=True)]

    def evaluate_full(self, program, values, flags) -> list:
        """The results, each with a lane axis."""
        results, out = self.evaluate(program, values, flags)
        return [self.broadcast(v, f) for v, f in zip(results, out, strict=True)]

    def trace(self, f: Callable, values: Sequence, flags: Sequence[bool]) -> forms.Program:
        """Trace `f`, which returns a list of arrays, for one lane of these values."""
        kinds = [jaxprs.element(v, -1 if on else None) for v, on in zip(values, flags, strict=True)]
        return forms.program(jax.make_jaxpr(f)(*kinds))

    def apply(self, f: Callable, values: Sequence, flags: Sequence[bool]) -> list:
        """Evaluate `f`, which is written for one lane and returns a list, for all lanes."""
        return self.evaluate_full(self.trace(f, values, flags), values, flags)

    def _equation(self, eqn, values, flags) -> Sequence:
        if not any(flags):
            return jaxprs.rebind(eqn)(*values)
        rule = registry.find(eqn).rule
        results = None if rule is None else rule(self, eqn, values, flags)
        if results is None:
            axes = [-1 if f else None for f in flags]
            one_lane = jax.vmap(jaxprs.rebind(eqn), axes, -1, axis_size=self.size)
            results = one_lane(*(force(x) for x in values))
        return results
