"""Each kind of rows agrees with its own matrix: applied, transposed and in `J^T W J`."""

import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

import jaxsim
from jaxsim.arrays.indexing import sum_by
from jaxsim.constraint.jacobian import DenseRows, DofRows, add_products, link_rows
from jaxsim.dynamics.tree import accumulate_outward

TREE = """
<mujoco><worldbody>
  <body><freejoint/><geom size=".1"/>
    <body pos=".2 0 0"><joint axis="0 1 0"/><geom size=".1"/></body>
    <body pos="-.2 0 0"><joint type="ball"/><geom size=".1"/></body></body>
  <body pos="0 0 1"><joint/><geom size=".1"/></body>
</worldbody></mujoco>
"""
COUNT = 7


def dof_rows(rng, tree):
    rows = DofRows(jnp.asarray(rng.standard_normal(COUNT)), tuple(rng.integers(0, tree.nv, COUNT)))
    return rows, np.asarray(rows.scale)[:, None] * np.eye(tree.nv)[list(rows.dof)]


def dense_rows(rng, tree):
    J = rng.standard_normal((COUNT, tree.nv))
    return DenseRows(jnp.asarray(J)), J


def rows_of_links(first, rng, tree, cdof):
    links = np.array([first(rng, len(tree)), rng.integers(-1, len(tree), COUNT)])
    G = rng.standard_normal((2, COUNT, 3, 6))
    one = lambda k: (G[k] @ cdof.T) * tree.moves[links[k]][:, None]  # noqa: E731
    rows = link_rows(links[0], jnp.asarray(G[0]), links[1], jnp.asarray(G[1]))
    return rows, one(1) - one(0)


@pytest.fixture(scope="module")
def tree():
    return jaxsim.load(mujoco.MjModel.from_xml_string(TREE)).tree


def agrees(rows, J, tree, cdof, rng):
    """Products with x, f and diagonal W, once J is flattened to a matrix."""
    close = lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-13, atol=1e-12)  # noqa: E731
    close(rows.dense(tree, jnp.asarray(cdof)), J)
    x, f = rng.standard_normal(tree.nv), rng.standard_normal(J.shape[:-1])
    a = accumulate_outward(tree, sum_by(jnp.asarray(cdof * x[:, None]), tree.dof_node, len(tree)))
    close(rows.apply(jnp.asarray(x), a), J @ x)
    flat = J.reshape(-1, tree.nv)
    force, wrench = rows.add_force(jnp.asarray(f), jnp.ones(tree.nv), jnp.zeros((len(tree), 6)))
    force = force - 1 + np.einsum("lv,vi,li->v", np.asarray(tree.moves)[:-1], cdof, wrench)
    close(force, flat.T @ f.ravel())
    return flat, np.abs(f)


@pytest.mark.parametrize("make", [dof_rows, dense_rows])
def test_rows_of_degrees_of_freedom(tree, make):
    rng = np.random.default_rng(0)
    with jax.enable_x64(True):
        cdof = rng.standard_normal((tree.nv, 6))
        rows, J = make(rng, tree)
        flat, w = agrees(rows, J, tree, cdof, rng)
        diagonal, same = rows.add_curvature(jnp.asarray(w), jnp.ones(tree.nv), None)
        np.testing.assert_allclose(diagonal - 1, np.diag(flat.T * w @ flat), rtol=1e-12)
        assert same is None


@pytest.mark.parametrize("first", ["the world", "some", "all move"])
def test_rows_of_two_links(tree, first):
    choose = {
        "the world": lambda rng, n: np.full(COUNT, -1),
        "some": lambda rng, n: rng.integers(-1, n, COUNT),
        "all move": lambda rng, n: rng.integers(0, n, COUNT),
    }[first]
    rng = np.random.default_rng(1)
    with jax.enable_x64(True):
        cdof = rng.standard_normal((tree.nv, 6))
        rows, J = rows_of_links(choose, rng, tree, cdof)
        assert rows.coupled == (first != "the world")
        flat, w = agrees(rows, J, tree, cdof, rng)
        start = jnp.ones((len(tree), 6, 6))
        matrices = rows.add_curvature(jnp.asarray(w), None, start)[1] - start
        axes = cdof[None] * np.asarray(tree.moves)[:-1, :, None]
        got = np.einsum("lvi,lij,lwj->vw", axes, matrices, axes)
        sides = [rows.replace(sides=(s,)).dense(tree, jnp.asarray(cdof)) for s in rows.sides]
        parts = [np.asarray(s).reshape(flat.shape) for s in sides]
        expected = sum(s.T * w.ravel() @ s for s in parts)
        np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-11)


@pytest.mark.parametrize("vmap", [jax.vmap, jaxsim.vmap])
@pytest.mark.parametrize("rows", ["single", "diagonal", "blocks"])
@pytest.mark.parametrize("rarely", [True, False])
def test_products_of_rows_that_push(vmap, rows, rarely, rng, x64):
    """Other contacts push in each element of the batch, and some in none."""
    J = rng.standard_normal((5, COUNT, 6) if rows == "single" else (5, COUNT, 3, 6))
    W = rng.standard_normal((*J.shape[:-1], 3) if rows == "blocks" else J.shape[:-1])
    pushes = rng.random((5, COUNT)) < 0.3
    pushes[:, 2], pushes[1, 4] = False, True
    W = W * pushes.reshape(5, COUNT, *[1] * (W.ndim - 2))
    H = rng.standard_normal((5, 6, 6))
    add = functools.partial(add_products, rarely=rarely)
    found = jax.jit(vmap(add))(H, J, W)
    WJ = W @ J if rows == "blocks" else W[..., None] * J
    flat = lambda x: x.reshape(5, -1, 6)  # noqa: E731
    expected = H + np.einsum("bri,brj->bij", flat(J), flat(WJ))
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    alone = jax.jit(add)(H[0], J[0], W[0])
    np.testing.assert_allclose(alone, expected[0], rtol=1e-12, atol=1e-12)
