"""Arguments of `vmap`: axes, pytrees, sizes and what is wrong with them."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from vmap_compare import assert_equal

from jaxsim.batching import vmap


def _arrays():
    rng = np.random.default_rng(0)
    return jnp.asarray(rng.normal(size=(2, 3, 4)), "float32")


def _both(f, *args, **axes):
    assert_equal(vmap(f, **axes)(*args), jax.vmap(f, **axes)(*args), 1e-6)


@pytest.mark.parametrize("axis", [0, 1, 2, -1, -2, -3])
def test_any_input_and_output_axis(axis):
    """Positive or negative."""
    x = _arrays()
    _both(lambda x: jnp.sin(x) * x[0, 0], x, in_axes=axis)
    _both(lambda x: x * 2, x, out_axes=axis)


def test_prefix_trees():
    """One axis may stand for a whole subtree, None for "not mapped"."""
    x = _arrays()
    tree = {"a": x, "b": (x[0], [x[1], jnp.float32(3)])}

    def f(tree, y):
        total = tree["a"] + tree["b"][0][0] + tree["b"][1][0][0] * tree["b"][1][1]
        return {"sum": total + y, "pair": (y, tree["b"][0])}

    axes = ({"a": 1, "b": (0, [0, None])}, None)
    _both(f, tree, jnp.ones((2, 4)), in_axes=axes)
    _both(f, tree, jnp.ones((2, 4)), in_axes=axes, out_axes={"sum": -1, "pair": 0})
    _both(f, tree, jnp.ones((2, 4)), in_axes=list(axes), out_axes={"sum": 1, "pair": (None, 1)})


def test_keywords_are_mapped_along_axis_zero():
    """Whatever in_axes says about the positional arguments."""
    x = _arrays()
    found = vmap(lambda a, *, b: a + b, in_axes=2)(x, b=jnp.ones((4, 2, 3)))
    assert_equal(found, jax.vmap(lambda a, *, b: a + b, in_axes=2)(x, b=jnp.ones((4, 2, 3))))


def test_unmapped_arguments_stay_concrete():
    """Numbers, functions and strings that are not mapped reach the function as they are."""
    x = _arrays()
    _both(lambda n, f, x: f(x)[:n], 2, jnp.sin, x, in_axes=(None, None, 0))
    _both(lambda x, mode: x if mode == "same" else -x, x, "same", in_axes=(0, None))


def test_axis_size():
    """Sets the batch where no argument does."""
    _both(lambda: jnp.arange(3), axis_size=4)
    _both(lambda x: x * 2, jnp.ones(3), in_axes=None, axis_size=2)
    _both(lambda x: x * 2, jnp.ones(3), axis_size=3)
    _both(lambda x: 3.0, jnp.ones(3), out_axes=None)


def test_empty_and_single_batches():
    """A batch of no lanes and one of one lane."""
    for size in (0, 1):
        _both(lambda x: jnp.tanh(x) @ x, jnp.ones((size, 3, 3)))


def test_results_that_are_constants_or_arguments():
    """Results need no operation to be results."""
    x = _arrays()
    _both(lambda x, y: (x, y, 1.0, np.arange(3), None, x), x, 2.0, in_axes=(0, None))


def test_types_survive():
    """Weak types, integers, booleans, complex numbers and half precision."""
    x = jnp.arange(6).reshape(2, 3)
    _both(lambda x: (x * 2, x > 1, x * 1.0, x * 1j, x.astype(jnp.bfloat16) * 2), x)
    _both(lambda x: (x.astype(jnp.bfloat16) @ x.astype(jnp.bfloat16), x @ x), x)
    _both(lambda s: s * 2, jax.vmap(lambda _: 2.0)(x))


def test_closed_over_tracers():
    """Of an outer transformation of either kind."""
    x = _arrays()[0]

    def f(batch):
        return lambda y: jax.grad(lambda s: jnp.sum(batch(lambda r: jnp.sin(r * s) @ y)(x)))(2.0)

    assert_equal(f(vmap)(x[0]), f(jax.vmap)(x[0]), 1e-5)
    assert_equal(jax.vmap(f(vmap))(x), jax.vmap(f(jax.vmap))(x), 1e-5)
    assert_equal(vmap(f(vmap))(x), jax.vmap(f(jax.vmap))(x), 1e-5)


X = np.ones(3, "float32")


@pytest.mark.parametrize(
    ("axes", "args"),
    [
        ({"in_axes": {"a": 0}}, (X,)),
        ({"in_axes": 1.5}, (X,)),
        ({"in_axes": (0, 0)}, (X,)),
        ({"in_axes": None}, (X,)),
        ({"in_axes": 2}, (X,)),
        ({"in_axes": -2}, (X,)),
        ({"in_axes": ((0, 0),)}, ([X, X],)),
        ({"in_axes": ("a",)}, (X,)),
        ({"axis_size": 4}, (X,)),
        ({"out_axes": None}, (X,)),
        ({"out_axes": 1}, (X,)),
        ({"out_axes": -2}, (X,)),
        ({"out_axes": (0, 0)}, (X,)),
        ({"out_axes": "a"}, (X,)),
        ({}, ([X, np.ones(4)],)),
        ({}, (3.0,)),
        ({}, ("a",)),
        ({}, ()),
    ],
)
def test_errors_are_of_the_same_kind(axes, args):
    """What `jax.vmap` rejects we reject, with the same type of error."""

    def f(*args):
        return args[0] if args else X

    with pytest.raises((TypeError, ValueError)) as expected:
        jax.vmap(f, **axes)(*args)
    with pytest.raises(type(expected.value), match=r"vmap|JAX type"):
        vmap(f, **axes)(*args)


def test_not_callable():
    """The function has to be one."""
    with pytest.raises(TypeError, match="callable"):
        vmap(3)
