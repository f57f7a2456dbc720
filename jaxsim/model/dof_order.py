"""Permutations of arrays over the degrees of freedom.

Users see MuJoCo's order. The recursions of the dynamics use tree order, in which a level of the
tree is a slice. The solver uses the tree order of the tree with compound joints.
"""

from jaxtyping import Array, Float

from jaxsim.arrays.indexing import take
from jaxsim.model.model import Model


def to_tree_order(model: Model, x: Float[Array, "nv ..."]) -> Float[Array, "nv ..."]:
    """From MuJoCo's order to tree order."""
    return take(x, model.structure.dof_order)


def from_tree_order(model: Model, x: Float[Array, "nv ..."]) -> Float[Array, "nv ..."]:
    """From tree order to MuJoCo's order."""
    return take(x, model.structure.dof_position)


def to_compound_order(model: Model, x: Float[Array, "nv ..."]) -> Float[Array, "nv ..."]:
    """From MuJoCo's order to the order of `Structure.compound`."""
    return take(x, model.structure.dof_order[model.structure.compound.dof])


def from_compound_order(model: Model, x: Float[Array, "nv ..."]) -> Float[Array, "nv ..."]:
    """From the order of `Structure.compound` to MuJoCo's."""
    return take(x, model.structure.compound.dof_position[model.structure.dof_position])
