"""Machine code: LLVM through llvmlite, an extra, for the processor of this machine."""

import functools
import os
from typing import Any


@functools.cache
def _llvm() -> Any:
    import llvmlite.binding

    llvmlite.binding.initialize_native_target()
    llvmlite.binding.initialize_native_asmprinter()
    return llvmlite.binding


def llvm_version() -> tuple[int, ...]:
    """The release of LLVM."""
    return tuple(_llvm().llvm_version_info)


@functools.cache
def processor() -> tuple[str, str]:
    """Name and features of this processor, as LLVM says them.

    `XLA_FLAGS=--xla_cpu_max_isa=AVX2` makes kernels do without AVX-512, as XLA's programs then do.
    """
    llvm = _llvm()
    name, features = llvm.get_host_cpu_name(), llvm.get_host_cpu_features().flatten()
    if "--xla_cpu_max_isa=AVX2" not in os.environ.get("XLA_FLAGS", ""):
        return name, features
    without = ["-" + f[1:] if f.startswith("+avx512") else f for f in features.split(",")]
    return name, ",".join(without)


@functools.cache
def lanes_of(itemsize: int) -> int:
    """Numbers of a size in one vector of this processor: 4, 8 or 16 of four bytes."""
    features = processor()[1].split(",")
    size = 64 if "+avx512f" in features else 32 if "+avx2" in features else 16
    return size // itemsize


def object_code(text: str) -> bytes:
    """An object file of a program in LLVM's text."""
    llvm = _llvm()
    module = llvm.parse_assembly(text)
    module.triple = llvm.get_process_triple()
    return _target().emit_object(module)


def _target() -> Any:
    llvm = _llvm()
    cpu, features = processor()
    target = llvm.Target.from_triple(llvm.get_process_triple())
    return target.create_target_machine(
        cpu=cpu,
        features=f"{features},-prefer-256-bit",
        opt=1,
        jit=True,
        codemodel="jitdefault",
    )


class Loaded:
    """Machine code in memory, kept as long as this object."""

    def __init__(self, code: bytes):
        llvm = _llvm()
        self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _target())
        self._engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self._engine.finalize_object()

    def address(self, name: str) -> int:
        """Where a function starts."""
        return self._engine.get_function_address(name)
