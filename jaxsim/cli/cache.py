"""A cache of compiled programs for the command line, in the user's cache directory.

Only the command line uses it: a library must not write files without being asked.
"""

import hashlib
import os
import pathlib
import platform
import sys

import jax

VARIABLE = "JAXSIM_CACHE"  # another directory, or nothing for no cache
LARGEST = 2_000_000_000  # bytes; beyond them the oldest programs go


def enable() -> pathlib.Path | None:
    """Turn on JAX's compilation cache, unless the user has already set one up.

    Returns:
      The directory, or None if there is no cache.
    """
    folder = directory()
    if folder is None or jax.config.jax_compilation_cache_dir:
        return None
    folder = folder / f"programs-{_processor()}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        _prune(folder)
    except OSError:
        return None
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.2)
    return folder


def directory() -> pathlib.Path | None:
    """The platform's cache directory of the user; None if the cache is turned off."""
    if VARIABLE in os.environ:
        chosen = os.environ[VARIABLE]
        return pathlib.Path(chosen) if chosen else None
    home = pathlib.Path("~").expanduser()
    if sys.platform == "win32":
        base = pathlib.Path(os.environ.get("LOCALAPPDATA") or home / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = home / "Library" / "Caches"
    else:
        base = pathlib.Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache")
    return base / "jaxsim"


def _processor() -> str:
    """A name for this type of processor, because several machines may share a home directory."""
    flags = [platform.machine(), platform.processor()]
    info = pathlib.Path("/proc/cpuinfo")
    if info.is_file():
        lines = info.read_text("utf-8", errors="replace").splitlines()
        wanted = ("flags", "Features", "model name")
        flags += sorted({line for line in lines if line.startswith(wanted)})
    return hashlib.sha256("\n".join(flags).encode()).hexdigest()[:12]


def _prune(folder: pathlib.Path) -> None:
    """Remove the oldest files until the total size is within the limit."""
    files = [(path, path.stat()) for path in folder.iterdir() if path.is_file()]
    excess = sum(stat.st_size for _, stat in files) - LARGEST
    for path, stat in sorted(files, key=lambda file: file[1].st_mtime):
        if excess <= 0:
            return
        path.unlink(missing_ok=True)
        excess -= stat.st_size
