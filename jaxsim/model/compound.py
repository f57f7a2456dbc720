"""Links with compound joints: all joints of a body together as one.

The links between the joints of one body have no inertia, and nothing acts on them. What needs only
the motion axes of the degrees of freedom, as solves do, can leave them out. MuJoCo gives a body no
more than six degrees of freedom.
"""

import dataclasses

import numpy as np

from jaxsim.model.topology import Forest


@dataclasses.dataclass(frozen=True, eq=False)
class Compound:
    """A forest with fewer nodes, and how it is numbered.

    Attributes:
      tree: the links that remain.
      link: (n,) number of each node among all links, tree order.
      node: (njnt + 1,) node of each link, tree order; -1, no link, has node -1.
      dof: (nv,) tree-order index of each degree of freedom.
      dof_position: (nv,) the inverse.
    """

    tree: Forest
    link: np.ndarray
    node: np.ndarray
    dof: np.ndarray
    dof_position: np.ndarray

    @classmethod
    def of(cls, tree: Forest, first: np.ndarray) -> "Compound":
        """Join joints.

        Args:
          tree: the links, one for each joint.
          first: (njnt,) in tree order: whether the link's joint is the first one of its body.
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
