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


@pytest.fixture
def doubled():
    """A primitive of somebody else."""
    primitive = jex.Primitive("doubled")
    primitive.def_impl(lambda x: 2 * x)
    primitive.def_abstract_eval(lambda x: x)
    batching.primitive_batchers[primitive] = lambda xs, axes: (primitive.bind(*xs), axes[0])
    mlir.register_lowering(primitive, mlir.lower_fun(lambda x: 2 * x, multiple_results=False))
    return primitive.bind


X = np.arange(6.0, dtype=np.float32).reshape(3, 2)


def test_programs_inside_are_batched_by_rules():
    """A primitive that can be read has a rule: `jax.vmap` of it would put the lanes in front."""
    for name, known in registry._PRIMITIVES.items():
        assert known.rule or not known.read, name


def test_an_unknown_primitive_is_batched_by_jax(doubled):
    np.testing.assert_array_equal(jaxsim.vmap(lambda x: doubled(x))(X), 2 * X)


def test_a_registered_rule_is_used(doubled, monkeypatch):
    """With the lanes as the last axis; a wrong rule shows that it is this one."""
    monkeypatch.setattr(registry, "_PRIMITIVES", dict(registry._PRIMITIVES))
    registry.register("doubled", rule=lambda lanes, eqn, values, flags: [values[0] + X.T])
    np.testing.assert_array_equal(jaxsim.vmap(lambda x: doubled(x))(X), 2 * X)
    np.testing.assert_array_equal(jaxsim.vmap(lambda x: doubled(x))(X + 1), 2 * X + 1)
