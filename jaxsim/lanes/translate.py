"""From a traced program of one environment to scalar operations.

An array is an array of nodes. What only moves numbers, as slices and transposes, moves nodes and
costs nothing when the program runs.
"""

from collections.abc import Callable, Sequence

import numpy as np
from jax.extend import core as jex

from jaxsim.lanes.program.builder import Builder

Rule = Callable[..., Sequence[np.ndarray] | np.ndarray | None]
RULES: dict[str, Rule] = {}
"""From (builder, equation, *operands) to the result or results; None: not this form."""


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Register a function for primitives of these names."""

    def register(function: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, function))
        return function

    return register


def evaluate(builder: Builder, program, values: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Results of a program (a `forms.Program`) of arrays of nodes.

    Raises:
      NotImplementedError: it has a primitive that this compiler does not know.
    """
    jaxpr = program.jaxpr
    env = dict(zip(jaxpr.invars, values, strict=True))
    for v, c in zip(jaxpr.constvars, program.consts, strict=True):
        env[v] = builder.constants(np.asarray(c))

    def look_up(atom):
        if isinstance(atom, jex.Literal):
            return builder.constants(np.asarray(atom.val, atom.aval.dtype))
        return env[atom]

    for eqn in jaxpr.eqns:
        results = equation(builder, eqn, [look_up(v) for v in eqn.invars])
        env.update(zip(eqn.outvars, results, strict=True))
    return [look_up(v) for v in jaxpr.outvars]


def equation(builder: Builder, eqn, values: list[np.ndarray]) -> list[np.ndarray]:
    """Results of one equation."""
    function = RULES.get(eqn.primitive.name)
    found = None if function is None else function(builder, eqn, *values)
    if found is None:
        raise NotImplementedError(f"the primitive {eqn.primitive.name}")
    single = isinstance(found, np.ndarray | np.generic)
    results = [np.asarray(x) for x in ((found,) if single else found)]
    for v, x in zip(eqn.outvars, results, strict=True):
        if x.shape != v.aval.shape:
            raise AssertionError(f"{eqn.primitive.name}: {x.shape} for {v.aval.shape}")
    return results
