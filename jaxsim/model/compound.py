"""Compound joints: a tree in which all joints of a body are one joint.

In the link tree, every joint has its own link, and those between the joints of one body have no
inertia. Solves need only the motion axes of the degrees of freedom, so they can use the smaller
tree without these links. A body has at most six degrees of freedom in MuJoCo.
"""

import dataclasses

import numpy as np

from jaxsim.model.topology import Forest


@dataclasses.dataclass(frozen=True, eq=False)
class Compound:
    """The tree with compound joints, and its numbering.

    Attributes:
      tree: the forest with one node for each body that has joints.
      link: (n,) link of each node, in the link tree's order.
      node: (njnt + 1,) node of each link, in the link tree's order; the last entry, -1, is for link
        -1, which stands for the world.
      dof: (nv,) index in the link tree's order of each degree of freedom.
      dof_position: (nv,) the inverse permutation.
    """

    tree: Forest
    link: np.ndarray
    node: np.ndarray
    dof: np.ndarray
    dof_position: np.ndarray

    @classmethod
    def of(cls, tree: Forest, first: np.ndarray) -> "Compound":
        """Merge the links of each body.

        Args:
          tree: the link tree, with one link for each joint.
          first: (njnt,) in tree order, whether the link's joint is the first of its body.
        """
        if first.all():
            dofs = np.arange(tree.nv)
            return cls(tree, np.arange(len(tree)), np.append(np.arange(len(tree)), -1), dofs, dofs)
        group = np.cumsum(first[tree.position]) - 1
        members = [np.nonzero(group == g)[0] for g in range(group[-1] + 1)]
        above = tree.parent[tree.position[[m[0] for m in members]]]
        parent = np.where(above >= 0, group[tree.order[above]], -1)
        ndof = tree.ndof[tree.position]
        sizes = np.bincount(group, ndof).astype(int)
        forest = Forest(parent, sizes, sizes)
        joints = [members[g] for g in forest.order]
        links = np.concatenate([tree.position[m] for m in joints])
        dof = np.concatenate([np.nonzero(tree.dof_node == link)[0] for link in links])
        return cls(
            tree=forest,
            link=tree.position[[m[-1] for m in joints]],
            node=np.append(forest.position[group[tree.order]], -1),
            dof=dof,
            dof_position=np.argsort(dof),
        )
