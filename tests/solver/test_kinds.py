"""Cost kinds: force and curvature are derivatives of the cost; zones, boundaries, padding."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from oracle import quick_jit

from jaxsim.solver import EllipticCone, Huber, PyramidalCone, Quadratic, Unilateral

NAMES = ["quadratic", "unilateral", "huber", "cone3", "cone4", "cone6"]
NAMES += ["pyramid3", "pyramid4", "pyramid6"]


@pytest.fixture
def block(request, x64, random_cone):
    rng = np.random.default_rng(0)
    aref, D, floss = jnp.asarray(rng.uniform(0.5, 2, size=(3, 40)))
    kinds = {
        "quadratic": lambda: Quadratic(aref, D),
        "unilateral": lambda: Unilateral(aref, D),
        "huber": lambda: Huber(aref, D, floss),
    }
    name, dim = request.param, request.param[-1]
    if name.startswith("pyramid"):
        shape = 40, int(dim)
        friction = rng.uniform(0.3, 2, size=(40, int(dim) - 1))
        return PyramidalCone(jnp.asarray(rng.normal(size=shape)), D, jnp.asarray(friction))
    return kinds[name]() if name in kinds else random_cone(0, 40, int(dim))


every_kind = pytest.mark.parametrize("block", NAMES, indirect=True)


def residual(block, seed=0):
    return jnp.asarray(2 * np.random.default_rng(seed).normal(size=block.aref.shape))


@every_kind
def test_force_is_minus_the_gradient_of_the_cost(block):
    r = residual(block)
    np.testing.assert_allclose(block.force(r), -jax.grad(block.cost)(r), rtol=1e-12, atol=1e-12)


@every_kind
def test_curvature_is_the_derivative_of_the_force(block):
    """Rows of different contacts do not interact, so one product per row of a contact suffices."""
    r = residual(block)
    W = block.curvature(r)
    if W.ndim == r.ndim:
        W, columns = W[..., None, None] * jnp.eye(1)[None], [jnp.ones_like(r)]
    else:
        columns = [jnp.zeros_like(r).at[:, j].set(1) for j in range(r.shape[-1])]
    for j, column in enumerate(columns):
        _, derivative = jax.jvp(block.force, (r,), (column,))
        np.testing.assert_allclose(W[..., j].reshape(r.shape), -derivative, atol=1e-12)
    np.testing.assert_allclose(W, jnp.swapaxes(W, -1, -2), atol=1e-14)
    assert np.linalg.eigvalsh(W).min() > -1e-12


@every_kind
def test_slopes_are_derivatives_along_a_line(block):
    r, v = residual(block), residual(block, 1)
    phi = lambda t: block.cost(r + t * v)  # noqa: E731
    first, second = block.slopes(r, v)
    np.testing.assert_allclose(first, jax.grad(phi)(0.0), rtol=1e-12)
    np.testing.assert_allclose(second, jax.grad(jax.grad(phi))(0.0), rtol=1e-12)


@every_kind
@pytest.mark.parametrize("size", [1e-9, 1.0, 3.0])
def test_change_is_the_difference_of_costs(block, size):
    r, step = residual(block), size * residual(block, 1)
    change, difference = block.change(r, step), block.cost(r + step) - block.cost(r)
    np.testing.assert_allclose(change, difference, rtol=1e-12, atol=1e-13 * float(block.cost(r)))
    if size < 1e-6:  # where the difference has lost its digits, the change has not
        first, second = block.slopes(r, step)
        np.testing.assert_allclose(change, first + 0.5 * second, rtol=1e-12)


@every_kind
def test_what_is_called_quadratic_is(block):
    """Contact by contact: the cost along the way is its expansion at the start, or it is not."""
    each = jax.tree.map(lambda a: a[:, None], block)

    @quick_jit
    @jax.vmap
    def quadratic_and_error(one, r, end):
        t = jnp.linspace(0, 1, 41)
        first, second = one.slopes(r, end - r)
        cost = jax.vmap(lambda t: one.cost(r + t * (end - r)))(t)
        expansion = cost[0] + t * first + 0.5 * t**2 * second
        return one.is_quadratic(r, end), jnp.abs(cost - expansion).max()

    whole_quadratic = quick_jit(lambda r, end: block.is_quadratic(r, end))
    seen = {True: 0, False: 0}
    for seed in range(20):
        r = residual(block, seed)[:, None]
        end = r + (0.2, 2.0)[seed % 2] * residual(block, 100 + seed)[:, None]
        quadratic, error = map(np.asarray, quadratic_and_error(each, r, end))
        assert error[quadratic].max(initial=0) < 1e-12
        # Zones that the way only grazes are told by no number of points.
        assert quadratic.all() or (error[~quadratic] > 1e-9).mean() > 0.95
        assert whole_quadratic(r[:, 0], end[:, 0]) == quadratic.all()
        seen[True] += int(quadratic.sum())
        seen[False] += int((~quadratic).sum())
    assert seen[True] > 20
    assert seen[False] > 20 or isinstance(block, Quadratic)


@every_kind
def test_padding_contributes_nothing(block):
    r = residual(block)
    off = jax.tree.map(jnp.zeros_like, block)
    for function in (off.cost, off.force, off.curvature):
        value, derivative = jax.jvp(function, (r,), (jnp.ones_like(r),))
        assert not np.any(value)
        assert not np.any(derivative)
    assert not np.any(off.slopes(r, r))
    assert not np.any(off.change(r, r))
    assert off.is_quadratic(r, -r)


@every_kind
def test_no_rows_cost_nothing(block):
    none = jax.tree.map(lambda a: a[:0], block)
    assert none.cost(none.aref) == 0
    assert none.force(none.aref).shape == none.aref.shape
    assert none.change(none.aref, none.aref) == 0
    assert none.is_quadratic(none.aref, none.aref)


def test_friction_loss_saturates_and_may_be_zero(x64):
    block = Huber(jnp.zeros(4), jnp.array([2.0, 2.0, 2.0, 2.0]), jnp.array([1.0, 1.0, 1.0, 0.0]))
    r = jnp.array([0.25, 3.0, -3.0, 5.0])
    np.testing.assert_allclose(block.force(r), [-0.5, -1, 1, 0])
    np.testing.assert_array_equal(block.curvature(r), [2, 0, 0, 0])
    for at in (r, jnp.zeros(4)):
        gradient = jax.grad(lambda b, at: b.cost(at), (0, 1))(block, at)
        assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))


def test_forces_lie_in_the_friction_cone(x64, random_cone):
    block = random_cone(0, 200, 4)
    f = np.asarray(block.force(residual(block)))
    # The regularised cone: mu in the place of friction[0] scales the whole cone.
    reach = np.sqrt(((f[:, 1:] / block.friction) ** 2).sum(-1))
    assert (f[:, 0] >= 0).all()
    assert (reach <= f[:, 0] * (1 + 1e-9) + 1e-12).all()


@pytest.mark.parametrize("dim", [3, 4, 6])
def test_a_pyramid_is_its_edges(x64, dim):
    """Each edge is a row of its own that may only push, with a Jacobian made of the contact's."""
    rng = np.random.default_rng(dim)
    n, mu = 30, rng.uniform(0, 2, size=(30, dim - 1))
    aref, D = rng.normal(size=(n, dim)), rng.uniform(0.5, 2, size=n)
    E = np.zeros((n, 2 * (dim - 1), dim))
    E[:, :, 0] = 1
    for j in range(dim - 1):
        E[:, 2 * j, j + 1], E[:, 2 * j + 1, j + 1] = mu[:, j], -mu[:, j]
    pyramid = PyramidalCone(*(jnp.asarray(a) for a in (aref, D, mu)))
    along = lambda r: jnp.einsum("nej,nj->ne", E, r)  # noqa: E731
    edges = Unilateral(along(aref), jnp.broadcast_to(D[:, None], E.shape[:2]))
    r, step = residual(pyramid), residual(pyramid, 1)
    close = lambda x, y: np.testing.assert_allclose(x, y, rtol=1e-12, atol=1e-12)  # noqa: E731
    close(pyramid.cost(r), edges.cost(along(r)))
    close(pyramid.change(r, step), edges.change(along(r), along(step)))
    close(pyramid.slopes(r, step), edges.slopes(along(r), along(step)))
    close(pyramid.force(r), jnp.einsum("nej,ne->nj", E, edges.force(along(r))))
    W = edges.curvature(along(r))
    close(pyramid.curvature(r), jnp.einsum("nei,ne,nej->nij", E, W, E))


def test_the_cone_is_smooth_across_its_zones(x64, random_cone):
    """Cost and force on either side of both boundaries."""
    block = random_cone(1, 5, 3)
    tangent = jnp.asarray(np.random.default_rng(2).normal(size=(5, 2)))
    T = jnp.sqrt(jnp.sum((block.friction * tangent) ** 2, axis=-1))
    for normal in (T, -T / block.mu**2):
        below, above = (
            jnp.concatenate([(normal + side)[:, None], tangent], axis=1) for side in (-1e-9, 1e-9)
        )
        np.testing.assert_allclose(block.force(below), block.force(above), atol=1e-7)
        np.testing.assert_allclose(block.cost(below), block.cost(above), rtol=1e-7, atol=1e-12)


@jax.jit
def everything(block, r):
    """Values and derivatives, once and twice, in both modes."""
    forces = jax.jacrev(lambda block, r: block.force(r), (0, 1))(block, r)
    bends = jax.jacfwd(lambda block, r: block.curvature(r), (0, 1))(block, r)
    values = block.cost(r), block.force(r), block.curvature(r), block.slopes(r, r)
    return forces, bends, values, block.change(r, -r), block.slopes(r, jnp.zeros_like(r))


@pytest.mark.parametrize(("mu", "friction"), [(0.5, 0.5), (0.0, 0.0), (0.5, 0.0)])
def test_the_cone_has_no_singular_point(x64, mu, friction):
    """At the apex, on the axis and on the boundaries, with and without friction."""
    D = jnp.array([[2.0, *(2.0 * (friction / mu) ** 2 if mu else 0.0,) * 3]])
    block = EllipticCone(jnp.zeros((1, 4)), D, jnp.array([mu]), jnp.full((1, 3), friction))
    for normal in (-1.0, 0.0, friction, 1.0):
        for tangent in (0.0, 1.0):
            r = jnp.array([[normal, tangent, 0.0, 0.0]])
            for leaf in jax.tree.leaves(everything(block, r)):
                assert np.isfinite(leaf).all()
            if friction == 0:
                np.testing.assert_allclose(block.cost(r), min(normal, 0) ** 2)


@pytest.mark.parametrize("block", ["pyramid3", "pyramid6"], indirect=True)
def test_edges_of_a_pyramid_add_up_to_its_rows(block):
    """The power of the edges is that of the rows, and no edge pulls."""
    r, v = residual(block), residual(block, seed=1)
    force = block.force(r)
    edges = block.spread(force)
    assert edges.min() > -1e-12
    power = jnp.sum(edges * block.edges(v), axis=1)
    np.testing.assert_allclose(power, jnp.sum(force * v, axis=1), atol=1e-12)
