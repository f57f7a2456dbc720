"""Numbers of the tests of batching."""

import numpy as np
import pytest


@pytest.fixture(autouse=True)
def same_numbers(request, monkeypatch):
    """Each test draws the same numbers, whichever tests ran before it in the same process."""
    if hasattr(request.module, "RNG"):
        monkeypatch.setattr(request.module, "RNG", np.random.default_rng(1))
