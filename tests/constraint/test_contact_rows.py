"""Rows of contacts are those of the Jacobian that they stand for, whatever the links."""

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.arrays.indexing import sum_by
from jaxsim.constraint.contact_rows import contact_rows
from jaxsim.dynamics.tree import accumulate_outward
from jaxsim.spatial import skew

TREE = """
<mujoco><worldbody>
  <body><freejoint/><geom size=".1"/>
    <body pos=".2 0 0"><joint axis="0 1 0"/><geom size=".1"/>
      <body pos=".2 0 0"><joint axis="0 1 0"/><geom size=".1"/></body></body>
    <body pos="-.2 0 0"><joint type="ball"/><geom size=".1"/></body>
  </body>{more}
</worldbody></mujoco>
"""
SECOND = '<body pos="0 0 1"><joint/><geom size=".1"/></body>'
COUNT = 13


def jacobian(rng, tree, cdof, condim, links):
    """The rows, and the matrix (n, rows, nv) that they stand for, from its definition."""
    frame = np.linalg.qr(rng.standard_normal((COUNT, 3, 3)))[0]
    # Links of one tree have the same reference point.
    arm = rng.standard_normal((tree.nroot, COUNT, 3))
    arms = [arm[np.where(k < 0, 0, tree.root[k]), np.arange(COUNT)] for k in links]
    rows = np.zeros((COUNT, condim, tree.nv))
    for sign, r, link in zip((-1, 1), arms, links, strict=True):
        for i in range(COUNT):
            turn, shift = cdof[:, :3], cdof[:, 3:] - cdof[:, :3] @ np.asarray(skew(r[i])).T
            motion = np.concatenate([frame[i] @ shift.T, frame[i] @ turn.T])
            rows[i] += sign * motion[:condim] * tree.moves[link[i]]
    arms = [jnp.asarray(r) for r in arms]
    return contact_rows(jnp.asarray(frame), condim, arms, links), rows


@pytest.mark.parametrize("condim", [1, 3, 4, 6])
@pytest.mark.parametrize("diagonal", [True, False])
@pytest.mark.parametrize("trees", [1, 2])
@pytest.mark.parametrize("ground", [True, False])
@pytest.mark.parametrize("static", [True, False])
def test_products_with_the_jacobian(condim, diagonal, trees, ground, static):
    rng = np.random.default_rng(condim)
    more = SECOND * (trees - 1)
    tree = jaxsim.load(mujoco.MjModel.from_xml_string(TREE.format(more=more))).tree
    links = rng.integers(-1, len(tree), (2, COUNT))
    if ground:
        links[0] = -1
    with jax.enable_x64(True):
        cdof = rng.standard_normal((tree.nv, 6))
        given = links if static else jnp.asarray(links)
        rows, J = jacobian(rng, tree, cdof, condim, links)
        if not static:
            rows = contact_rows(rows.frame, condim, *_ends(rows, given))
        assert rows.coupled == (not ground or not static)
        close = lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-13, atol=1e-12)  # noqa: E731
        close(rows.dense(tree, jnp.asarray(cdof)), J)

        x, f = rng.standard_normal(tree.nv), rng.standard_normal(J.shape[:2])
        rate = sum_by(jnp.asarray(cdof * x[:, None]), tree.dof_node, len(tree))
        close(rows.apply(None, accumulate_outward(tree, rate)), J @ x)

        start = jnp.ones((len(tree), 6))
        wrench = rows.add_force(jnp.asarray(f), None, start)[1] - start
        close(_dofs(tree, cdof, wrench), np.einsum("nrv,nr->v", J, f))

        W = np.einsum("nij,nkj->nik", *2 * [rng.standard_normal((*J.shape[:2], J.shape[1]))])
        if diagonal:
            W = np.abs(f)
        start = jnp.ones((len(tree), 6, 6))
        matrix = rows.add_curvature(jnp.asarray(W), None, start)[1] - start
        full = W if W.ndim == 3 else np.stack([np.diag(w) for w in W])
        expected = sum(
            np.einsum("nrv,nrs,nsw->vw", one, full, one)
            for one in (jacobian_of_side(rows, tree, cdof, side) for side in rows.sides)
        )
        axes = cdof[None] * np.asarray(tree.moves)[:-1, :, None]
        close(np.einsum("lvi,lij,lwj->vw", axes, matrix, axes), expected)


def jacobian_of_side(rows, tree, cdof, side):
    """J as it were if only one of the links could move."""
    return np.asarray(rows.replace(sides=(side,)).dense(tree, jnp.asarray(cdof)))


def _dofs(tree, cdof, wrench):
    """Generalised forces of wrenches on the links."""
    return np.einsum("lv,vi,li->v", np.asarray(tree.moves)[:-1], cdof, wrench)


def _ends(rows, links):
    arms = [side.arm for side in rows.sides]
    return [arms[0], arms[-1]], links
