"""The command line in these tests keeps nothing in the user's cache directory."""

import pytest


@pytest.fixture(autouse=True)
def no_cache(monkeypatch):
    """No programs are kept."""
    monkeypatch.setenv("JAXSIM_CACHE", "")
