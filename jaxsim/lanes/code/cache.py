"""Machine code on disk, beside the programs in JAX's compilation cache.

Nothing is written unless that cache is in use (`jax_compilation_cache_dir`). A damaged file is
taken for none, for wrong machine code would end the process.
"""

import hashlib
import os
import pathlib
import tempfile

import jax

PREFIX = "jaxsim-lanes-"


def load(key: str) -> bytes | None:
    """The object file of a key, or None."""
    path = _path(key)
    try:
        content = path.read_bytes() if path else b""
    except OSError:
        return None
    digest, code = content[:32], content[32:]
    return code if code and hashlib.sha256(code).digest() == digest else None


def save(key: str, code: bytes) -> None:
    """Keep an object file; a full or read-only disk is no error."""
    path = _path(key)
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=PREFIX)
        with os.fdopen(handle, "wb") as file:
            file.write(hashlib.sha256(code).digest() + code)
        pathlib.Path(name).replace(path)
    except OSError:
        return


def _path(key: str) -> pathlib.Path | None:
    config = jax.config
    if not (config.jax_enable_compilation_cache and config.jax_compilation_cache_dir):
        return None
    if "://" in config.jax_compilation_cache_dir:  # storage of a cloud
        return None
    return pathlib.Path(config.jax_compilation_cache_dir) / f"{PREFIX}{key}"
