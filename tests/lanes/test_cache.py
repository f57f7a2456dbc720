"""Machine code on disk: found again, and never trusted when damaged."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxsim.lanes import as_kernel, compiler
from jaxsim.lanes.code import cache


@pytest.fixture
def folder(tmp_path):
    """JAX's compilation cache in an empty folder."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", str(tmp_path))
    yield tmp_path
    jax.config.update("jax_compilation_cache_dir", before)


def test_machine_code_is_found_again(folder, monkeypatch):
    x = jnp.arange(20.0)
    f = lambda x: 3 * x + jnp.tanh(x)  # noqa: E731
    expected = 3 * x + jnp.tanh(x)
    np.testing.assert_allclose(jax.vmap(as_kernel(f))(x), expected, rtol=1e-6)
    assert len([p for p in folder.iterdir() if p.name.startswith(cache.PREFIX)]) == 1
    # As in another process, which may compile nothing.
    compiler.kernel.cache_clear()
    compiler._REGISTERED.clear()
    monkeypatch.setattr(compiler, "source", None)
    monkeypatch.setattr(jax.ffi, "register_ffi_target", lambda *args, **kwargs: None)
    traced = jax.make_jaxpr(f)(x[0])
    assert compiler.kernel(traced, (True,)).width > 1


def test_damaged_files_are_none(folder):
    cache.save("a", b"code")
    assert cache.load("a") == b"code"
    path = folder / f"{cache.PREFIX}a"
    path.write_bytes(path.read_bytes()[:-1] + b"x")
    assert cache.load("a") is None
    assert cache.load("b") is None


def test_without_a_folder_nothing_is_written(folder):
    jax.config.update("jax_compilation_cache_dir", None)
    cache.save("a", b"code")
    assert cache.load("a") is None
