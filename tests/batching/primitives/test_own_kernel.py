"""Functions that a CPU computes by themselves are the same functions everywhere."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import export
from vmap_compare import assert_same

from jaxsim.batching.primitives.own_kernel import fusion_barrier, own_kernel
from jaxsim.parallel.devices import AXIS, device_mesh


def _softened(x, *, scale):
    return jnp.stack([jnp.tanh(scale * x), x * jnp.sum(x)])


def _soft(x):
    return own_kernel(_softened, x, scale=1.5)


POINT = np.linspace(-1.0, 1.2, 6).reshape(2, 3)
pytestmark = pytest.mark.usefixtures("x64")


def test_values():
    np.testing.assert_array_equal(fusion_barrier(POINT), POINT)
    expected = _softened(POINT, scale=1.5)
    np.testing.assert_allclose(_soft(POINT), expected, rtol=1e-15)
    np.testing.assert_allclose(jax.jit(_soft)(POINT), expected, rtol=1e-15)


@pytest.mark.parametrize("f", [fusion_barrier, _soft])
def test_batches_and_derivatives(f):
    """Of `jax.vmap`, of ours, of one in the other, forwards and backwards."""
    assert_same(f, POINT)
    assert_same(lambda x: jax.vmap(f, out_axes=1)(x), np.stack([POINT, POINT + 1]))


def test_second_derivatives():
    plain = functools.partial(_softened, scale=1.5)
    hessians = [jax.jacfwd(jax.jacrev(f))(POINT) for f in (_soft, plain)]
    np.testing.assert_allclose(*hessians, rtol=1e-14)


def test_linear_functions_are_transposed():
    """Also where nothing but zeros comes back."""
    doubled = lambda x: own_kernel(_doubled, x)  # noqa: E731
    (back,) = jax.linear_transpose(doubled, POINT)(POINT)
    np.testing.assert_array_equal(back, 2 * POINT)
    grad = jax.grad(lambda x: jnp.sum(jax.lax.stop_gradient(doubled(x)) + x))(POINT)
    np.testing.assert_array_equal(grad, jnp.ones_like(POINT))


def _doubled(x):
    return x + x


def test_only_cpus_keep_the_call():
    """A GPU would run each of them as a kernel of its own."""
    program = lambda p: export.export(jax.jit(_soft), platforms=[p])(POINT).mlir_module()  # noqa: E731
    called = {p: "inlineable" in program(p) for p in ("cpu", "cuda", "tpu")}
    assert called == {"cpu": True, "cuda": False, "tpu": False}


@pytest.mark.parametrize("check_vma", [True, False])
def test_on_one_mesh_after_the_other(check_vma):
    """The program of a function for one mesh is not that for another."""
    rows = np.linspace(-1, 1, 8).reshape(4, 2)
    for count in (1, 2, 1):
        mesh, spec = device_mesh(jax.devices()[:count]), jax.P(AXIS)
        split = jax.shard_map(
            jax.vmap(_soft), mesh=mesh, in_specs=spec, out_specs=spec, check_vma=check_vma
        )
        expected = jax.vmap(lambda x: _softened(x, scale=1.5))(rows)
        np.testing.assert_allclose(jax.jit(split)(rows), expected, rtol=1e-14)
