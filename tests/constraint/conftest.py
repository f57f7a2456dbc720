"""Constraints are compared in float64 unless a test says otherwise."""

import jax
import pytest


@pytest.fixture(autouse=True)
def double_precision(request):
    """Float64, except for tests that ask for `x32`."""
    with jax.enable_x64("x32" not in request.fixturenames):
        yield


@pytest.fixture
def x32():
    """Float32 for the test that asks for it."""
