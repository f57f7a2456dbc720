"""Constraint solves with fewer contact slots, while few of them are active in a batch.

A model has a slot for every possible contact, and most are inactive. In a batch, an inactive slot
costs as much as an active one. So if only few slots are active in any environment of the batch,
the solve is done with these slots only.
"""

import functools
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jax import lax
from jaxtyping import Array, Bool, Int

from jaxsim.arrays import tuning
from jaxsim.batching.primitives.decisions import (
    index_of_nth,
    is_batched,
    nonzero_in_batch,
    serial_or_parallel,
)
from jaxsim.constraint.contact_rows import ContactRows
from jaxsim.constraint.jacobian import Jacobian, LinkRows
from jaxsim.constraint.link_index import items
from jaxsim.constraint.operators import TreeOperator
from jaxsim.solver import Kind, Problem

T = TypeVar("T")


def with_compacted_contacts(
    run: Callable[[Problem, TreeOperator], T],
    problem: Problem,
    operator: TreeOperator,
) -> T:
    """`run(problem, operator)`, in a batch with fewer contact slots if these are enough.

    Only articulated solves are compacted: others cost much more than their contacts. A program for
    one environment is not compacted, because compiling a second solve would not pay.

    Args:
      run: function whose result does not depend on contacts with `D = 0`.
      problem: the blocks of rows.
      operator: the operator with the Jacobians of the blocks.

    Returns:
      The result of `run`.
    """
    pairs = enumerate(zip(operator.jacobians, problem.blocks, strict=True))
    many = [
        i
        for i, (J, kind) in pairs
        if _is_of_links(J) and len(kind.aref) >= tuning.COMPACTION_CONTACTS
    ]
    if operator.strategy != "articulated" or not many:
        return run(problem, operator)

    ranks = {i: jnp.cumsum(nonzero_in_batch(problem.blocks[i].D)) for i in many}
    fits = jnp.all(jnp.stack([rank[-1] <= tuning.COMPACTED_CONTACTS for rank in ranks.values()]))
    fits = fits & is_batched(problem.blocks[many[0]].D)
    pays = serial_or_parallel(lambda fits: fits, jnp.zeros_like, fits)
    compacted = lambda: run(*_compacted(problem, operator, ranks))  # noqa: E731
    return lax.cond(pays, compacted, lambda: run(problem, operator))


def _is_of_links(J: Jacobian) -> bool:
    return isinstance(J, ContactRows | LinkRows)


def _compacted(problem: Problem, operator: TreeOperator, ranks: dict[int, Array]):
    """The problem and the operator with the first active contacts of some blocks."""
    kinds, jacobians = list(problem.blocks), list(operator.jacobians)
    item = jnp.arange(tuning.COMPACTED_CONTACTS)
    for i, rank in ranks.items():
        index = jax.vmap(functools.partial(index_of_nth, rank))(item)
        kinds[i] = _kept(kinds[i], index, item < rank[-1])
        jacobians[i] = jacobians[i].items(index)
    return Problem(tuple(kinds)), operator.replace(jacobians=tuple(jacobians))


def _kept(kind: Kind, index: Int[Array, "k"], exists: Bool[Array, "k"]) -> Kind:
    kind = jax.tree.map(lambda x: items(x, index), kind)
    exists = exists.reshape(-1, *(1,) * (kind.D.ndim - 1))
    return kind.replace(D=jnp.where(exists, kind.D, 0))
