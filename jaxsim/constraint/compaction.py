"""A solve without the contacts that cannot push, where few can.

A model has a slot for every contact that it may have, and most are empty. What a solver does with a
slot costs a batch the same, empty or not. So slots that are empty in all of a batch are left out
where the others are few.
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
    """`run(problem, operator)`; in a batch with `FEW_CONTACTS` slots of a kind, if no more push.

    Other than articulated solves cost so much more than their contacts that it would not pay, and
    one environment alone is too quick to repay the second program's compilation.

    Args:
      run: what does not depend on contacts with `D = 0`.
      problem: the blocks of rows.
      operator: with their Jacobians.
    """
    pairs = enumerate(zip(operator.jacobians, problem.blocks, strict=True))
    many = [
        i for i, (J, kind) in pairs if _is_of_links(J) and len(kind.aref) >= tuning.MANY_CONTACTS
    ]
    if operator.strategy != "articulated" or not many:
        return run(problem, operator)

    ranks = {i: jnp.cumsum(nonzero_in_batch(problem.blocks[i].D)) for i in many}
    few = jnp.all(jnp.stack([rank[-1] <= tuning.FEW_CONTACTS for rank in ranks.values()]))
    few = few & is_batched(problem.blocks[many[0]].D)
    pays = serial_or_parallel(lambda few: few, jnp.zeros_like, few)
    shortened = lambda: run(*_shortened(problem, operator, ranks))  # noqa: E731
    return lax.cond(pays, shortened, lambda: run(problem, operator))


def _is_of_links(J: Jacobian) -> bool:
    return isinstance(J, ContactRows | LinkRows)


def _shortened(problem: Problem, operator: TreeOperator, ranks: dict[int, Array]):
    """The problem with the first items that push of some blocks."""
    kinds, jacobians = list(problem.blocks), list(operator.jacobians)
    item = jnp.arange(tuning.FEW_CONTACTS)
    for i, rank in ranks.items():
        index = jax.vmap(functools.partial(index_of_nth, rank))(item)
        kinds[i] = _kept(kinds[i], index, item < rank[-1])
        jacobians[i] = jacobians[i].items(index)
    return Problem(tuple(kinds)), operator.replace(jacobians=tuple(jacobians))


def _kept(kind: Kind, index: Int[Array, "k"], exists: Bool[Array, "k"]) -> Kind:
    kind = jax.tree.map(lambda x: items(x, index), kind)
    exists = exists.reshape(-1, *(1,) * (kind.D.ndim - 1))
    return kind.replace(D=jnp.where(exists, kind.D, 0))
