"""NVIDIA's assembler and linker: PTX of several modules becomes one program of machine code.

The driver assembles a program by one thread, in a time that grows faster than its length. Here
modules are assembled by processes of their own. Both tools come with JAX for CUDA.
"""

import concurrent.futures
import ctypes
import functools
import pathlib
import re
import subprocess
import sys
import tempfile

CUBIN = 1  # nvJitLinkInputType
LIBRARY = re.compile(r"libnvJitLink\.so\.(\d+)$")


def machine_code(modules: list[str], capability: int) -> bytes | None:
    """One program of the modules, for one kind of device; None where the tools do not make it.

    Args:
      modules: PTX, whose functions call each other.
      capability: of the device, 90 for 9.0.
    """
    ptxas, library = _tools()
    if ptxas is None or library is None:
        return None
    with tempfile.TemporaryDirectory() as folder, concurrent.futures.ThreadPoolExecutor() as pool:
        files = [pathlib.Path(folder) / f"{i}.ptx" for i in range(len(modules))]
        assemble = functools.partial(_assemble, ptxas, capability)
        try:
            return _link(library, list(pool.map(assemble, files, modules)), capability)
        except (AttributeError, OSError, subprocess.CalledProcessError):  # other names, versions
            return None


def _assemble(ptxas: pathlib.Path, capability: int, file: pathlib.Path, ptx: str) -> bytes:
    file.write_text(ptx)
    made = file.with_suffix(".cubin")
    command = [ptxas, f"-arch=sm_{capability}", "-c", file, "-o", made]
    subprocess.run(command, check=True, capture_output=True)
    return made.read_bytes()


def _link(library: pathlib.Path, parts: list[bytes], capability: int) -> bytes:
    """Raises an OSError if they do not fit together."""
    linker, option = _Linker(library), f"-arch=sm_{capability}".encode()
    handle, size = ctypes.c_void_p(), ctypes.c_size_t()
    linker("Create", ctypes.byref(handle), 1, (ctypes.c_char_p * 1)(option))
    try:
        for part in parts:
            linker("AddData", handle, CUBIN, part, ctypes.c_size_t(len(part)), b"lanes")
        linker("Complete", handle)
        linker("GetLinkedCubinSize", handle, ctypes.byref(size))
        code = ctypes.create_string_buffer(size.value)
        linker("GetLinkedCubin", handle, code)
    finally:
        linker("Destroy", ctypes.byref(handle))
    return code.raw


class _Linker:
    """Functions of nvJitLink, by the names of the first release of its major version."""

    def __init__(self, library: pathlib.Path):
        self._library, self._major = ctypes.CDLL(str(library)), library.suffix.removeprefix(".")

    def __call__(self, name: str, *arguments) -> None:
        code = getattr(self._library, f"__nvJitLink{name}_{self._major}_0")(*arguments)
        if code:
            raise OSError(f"nvJitLink answers {code} to {name}")


@functools.cache
def _tools() -> tuple[pathlib.Path | None, pathlib.Path | None]:
    """The assembler and the linker, from wheels of NVIDIA's."""
    found = [p for path in sys.path if path for p in (pathlib.Path(path) / "nvidia").glob("*")]
    assemblers = (p / "bin" / "ptxas" for p in found)
    libraries = (file for p in found for file in p.glob("lib/libnvJitLink.so.*"))
    return (
        next((p for p in assemblers if p.is_file()), None),
        next((p for p in libraries if LIBRARY.search(p.name)), None),
    )
