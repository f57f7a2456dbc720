"""Concatenations and stacks in sections, in a form that LLVM vectorises.

If XLA fuses a concatenation with the computation of its parts, the loop has a branch in its body
and LLVM does not vectorise it. So the parts are computed first. Parts of one row each, as those of
a stack, share a loop, which computes all of them for every row and selects one. That is more
arithmetic, but there are fewer loops to compile and to start.
"""

import itertools
from collections.abc import Sequence

import jax
import jax.numpy as jnp
from jax import lax
from jax.extend import core as jex
from jax.interpreters import mlir

from jaxsim.arrays import tuning
from jaxsim.batching.primitives.own_kernel import fusion_barrier

JOINING = "concatenate", "stack"


def with_parts_first(eqn, made: set):
    """A concatenation or stack whose parts that are in `made` are computed before it."""
    first = tuple(isinstance(v, jex.Var) and v in made for v in eqn.invars)
    return eqn.replace(primitive=parts_first_p, params={"whole": eqn, "first": first})


def _put_together(*parts, whole, first):
    axis = whole.params["axis" if whole.primitive.name == "stack" else "dimension"]
    if whole.primitive.name == "stack":
        parts = [lax.expand_dims(x, [axis]) for x in parts]
    is_minor = axis == parts[0].ndim - 1
    flags = [f and x.shape[axis] == 1 and not is_minor for x, f in zip(parts, first, strict=True)]
    pieces = []
    for rows, run in itertools.groupby(zip(flags, parts, first, strict=True), lambda p: p[0]):
        run = list(run)
        if rows:
            pieces += _selected([x for _, x, _ in run], axis)
        else:
            pieces += [fusion_barrier(x) if f else x for _, x, f in run]
    return pieces[0] if len(pieces) == 1 else lax.concatenate(pieces, axis)


def _selected(rows: Sequence[jax.Array], axis: int) -> list[jax.Array]:
    """Concatenation of rows of length one along the axis, `SELECTED_ROWS` at a time in one loop."""
    groups = [rows[i : i + tuning.SELECTED_ROWS] for i in range(0, len(rows), tuning.SELECTED_ROWS)]
    return [fusion_barrier(_select_row(group, axis)) for group in groups]


def _select_row(rows: Sequence[jax.Array], axis: int) -> jax.Array:
    if len(rows) == 1:
        return rows[0]
    shape = (*rows[0].shape[:axis], len(rows), *rows[0].shape[axis + 1 :])
    number = lax.broadcasted_iota(jnp.int32, shape, axis)
    which = number != 0 if len(rows) == 2 else number
    return lax.select_n(which, *(lax.broadcast_in_dim(x, shape, range(x.ndim)) for x in rows))


parts_first_p = jex.Primitive("concatenate_parts_first")
parts_first_p.def_abstract_eval(lambda *_, whole, first: whole.outvars[0].aval)
mlir.register_lowering(parts_first_p, mlir.lower_fun(_put_together, multiple_results=False))
