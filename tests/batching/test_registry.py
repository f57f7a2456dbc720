"""What is known of primitives is registered once, in the file of their rule."""

import re
from pathlib import Path

import numpy as np
import pytest
from jax.extend import core as jex
from jax.interpreters import batching, mlir

import jaxsim
from jaxsim.batching import primitives, registry


def test_a_primitive_is_registered_once():
    with pytest.raises(ValueError, match="'sin' is registered twice"):
        registry.register("sin")


def test_all_files_of_primitives_are_imported():
    """Else what they register would be unknown."""
    files = Path(primitives.__file__).parent.glob("*.py")
    registering = {p.stem for p in files if re.search(r"^ *register\(", p.read_text(), re.M)}
    assert len(registering) > 10
    assert registering <= set(primitives.__all__)


def test_an_unknown_primitive_is_batched_by_jax():
    """It gets an axis in front and no rule of ours."""
    doubled = jex.Primitive("of somebody else")
    doubled.def_impl(lambda x: 2 * x)
    doubled.def_abstract_eval(lambda x: x)
    batching.primitive_batchers[doubled] = lambda values, axes: (doubled.bind(*values), axes[0])
    mlir.register_lowering(doubled, mlir.lower_fun(lambda x: 2 * x, multiple_results=False))
    x = np.arange(6.0, dtype=np.float32).reshape(3, 2)
    np.testing.assert_array_equal(jaxsim.vmap(lambda x: doubled.bind(x))(x), 2 * x)
