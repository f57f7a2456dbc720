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
    in_cpu_kernel,
    index_of_nth,
    is_batched,
    nonzero_in_batch,
    serial_or_parallel,
)
from jaxsim.constraint.contact_rows import ContactRows
from jaxsim.constraint.jacobian import Jacobian, LinkRows
from jaxsim.constraint.link_index import items
from jaxsim.constraint.operators import TreeOperator
from jaxsim.lanes.switch import lanes_enabled
from jaxsim.solver import Kind, Problem

T = TypeVar("T")


def with_compacted_contacts(
    run: Callable[[Problem, TreeOperator], T],
    problem: Problem,
    operator: TreeOperator,
) -> T:
    """`run(problem, operator)`, in a batch with fewer contact slots if these are enough.

    In a kernel for a CPU, each group of lanes has the choice between two smaller numbers.
    Only articulated solves are compacted: others cost much more than their contacts. A program for
    one environment is not compacted, because compiling a second solve would not pay.

    Args:
      run: function whose result does not depend on contacts with `D = 0`.
      problem: the blocks of rows.
      operator: the operator with the Jacobians of the blocks.

    Returns:
      The result of `run`.
    """
    found = lambda: run(problem, operator)  # noqa: E731
    if operator.strategy == "articulated":
        found = _with_slots(tuning.COMPACTED_CONTACTS, is_batched, run, problem, operator, found)
        if lanes_enabled():
            slots = tuning.COMPACTED_IN_KERNEL
            found = _with_slots(slots, in_cpu_kernel, run, problem, operator, found)
    return found()


def _with_slots(
    slots: int,
    where: Callable[[Array], Bool[Array, ""]],
    run: Callable[[Problem, TreeOperator], T],
    problem: Problem,
    operator: TreeOperator,
    otherwise: Callable[[], T],
) -> Callable[[], T]:
    """`run` with so many slots in each block if these are enough, and it is computed `where`."""
    pairs = enumerate(zip(operator.jacobians, problem.blocks, strict=True))
    least = tuning.COMPACTION_FACTOR * slots
    many = [i for i, (J, kind) in pairs if _is_of_links(J) and len(kind.aref) >= least]
    if not many:
        return otherwise
    ranks = {i: jnp.cumsum(nonzero_in_batch(problem.blocks[i].D)) for i in many}
    fits = jnp.all(jnp.stack([rank[-1] <= slots for rank in ranks.values()]))
    pays = serial_or_parallel(lambda x: x, jnp.zeros_like, fits & where(problem.blocks[many[0]].D))
    compacted = lambda: run(*_compacted(problem, operator, ranks, slots))  # noqa: E731
    return lambda: lax.cond(pays, compacted, otherwise)


def _is_of_links(J: Jacobian) -> bool:
    return isinstance(J, ContactRows | LinkRows)


def _compacted(problem: Problem, operator: TreeOperator, ranks: dict[int, Array], slots: int):
    """The problem and the operator with the first active contacts of some blocks."""
    kinds, jacobians = list(problem.blocks), list(operator.jacobians)
    item = jnp.arange(slots)
    for i, rank in ranks.items():
        index = jax.vmap(functools.partial(index_of_nth, rank))(item)
        kinds[i] = _kept(kinds[i], index, item < rank[-1])
        jacobians[i] = jacobians[i].items(index)
    return Problem(tuple(kinds)), operator.replace(jacobians=tuple(jacobians))


def _kept(kind: Kind, index: Int[Array, "k"], exists: Bool[Array, "k"]) -> Kind:
    kind = jax.tree.map(lambda x: items(x, index), kind)
    exists = exists.reshape(-1, *(1,) * (kind.D.ndim - 1))
    return kind.replace(D=jnp.where(exists, kind.D, 0))
