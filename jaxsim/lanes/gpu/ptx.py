"""PTX of a program in LLVM's text: one thread for each lane.

What a piece leaves for others lies in local memory, which the hardware interleaves: threads of a
warp read and write neighbouring words. Functions of the C library are those of libdevice, which
comes with JAX for CUDA.
"""

import functools
import pathlib
import re
import sys
from typing import Any

from jaxsim.lanes.code.emit import Emitter, Pointers
from jaxsim.lanes.gpu.assembler import machine_code
from jaxsim.lanes.gpu.modules import divide

TRIPLE = "nvptx64-nvidia-cuda"
POINTERS = Pointers(frame="ptr addrspace(5)", array="ptr addrspace(1)")
# Operations of a piece. What another piece needs goes through memory: with 6,000 instead of 1,500,
# 32,768 environments of hopper are 1.24 times as fast on an H100, half_cheetah and humanoid 1.14.
LONGEST = 6_000
# Operations of a program that is assembled in parts. NVIDIA's assembler takes 48 s for the 162,000
# of Gymnasium's humanoid; for sixteen parts 15 s together, 2 s for the longest. A function of
# another part saves registers that nobody needs: some 13 per cent more is read and written.
LARGE, PARTS = 100_000, 16
# PTX for an older architecture also runs on newer ones, this one's machine code does not.
NEWEST = 90
LIBDEVICE = "nvvm/libdevice/libdevice.10.bc"
DECLARED = re.compile(r"^declare [^@]+@([a-z]\w*)\(", re.MULTILINE)


def code(emitter: Emitter, parameters: int, capability: int) -> bytes:
    """A program whose entry is called `lanes`, as CUDA's driver takes it.

    A long one is assembled here, in parts; the driver makes machine code of others.

    Args:
      emitter: a program for one lane, with `POINTERS`.
      parameters: number of arguments and results.
      capability: of the device, 90 for 9.0.

    Raises:
      NotImplementedError: the program calls the C library, and libdevice is not installed.
    """
    text = program(emitter, parameters)
    if emitter.operations > LARGE:
        modules = [ptx(part, capability) for part in divide(text, PARTS)]
        assembled = machine_code(modules, capability)
        if assembled is not None:
            return assembled
    return ptx(text, capability).encode() + b"\0"


def program(emitter: Emitter, parameters: int) -> str:
    """LLVM's text of a program with its entry, for which functions are those of libdevice."""
    text = "\n".join((emitter.module(), entry(parameters, emitter.frame_bytes)))
    called = set(DECLARED.findall(text))
    return re.sub(r"@([a-z]\w*)\(", lambda m: f"@__nv_{m[1]}(" if m[1] in called else m[0], text)


def ptx(text: str, capability: int) -> str:
    """PTX of a module in LLVM's text; errors as for `code`."""
    llvm = _llvm()
    module = llvm.parse_assembly(text)
    module.triple = TRIPLE
    target = llvm.Target.from_triple(TRIPLE)
    machine = target.create_target_machine(cpu=f"sm_{min(capability, NEWEST)}", opt=2)
    ours = {f.name for f in module.functions if not f.is_declaration}
    if "@__nv_" in text:
        library = llvm.parse_bitcode(_libdevice().read_bytes())
        module.data_layout = library.data_layout
        module.link_in(library)
    module.data_layout = str(machine.target_data)
    for function in module.functions:
        if not (function.is_declaration or function.name in ours):
            function.linkage = "internal"
    _optimise(module, machine)
    return machine.emit_assembly(module)


def entry(parameters: int, frame_bytes: int) -> str:
    """Text of the function that each thread runs: it finds its lane and calls `@group`."""
    addresses = [f"{POINTERS.array} %a{k}" for k in range(parameters)]
    table = [
        f"  %s{k} = getelementptr ptr, {POINTERS.frame} %p, i64 {k}\n"
        f"  store {POINTERS.array} %a{k}, {POINTERS.frame} %s{k}"
        for k in range(parameters)
    ]
    registers = {"thread": "tid", "block": "ctaid", "threads": "ntid"}
    read = "@llvm.nvvm.read.ptx.sreg.{}.x()"
    return "\n".join(
        [
            *(f"declare i32 {read.format(r)}" for r in registers.values()),
            f"define ptx_kernel void @lanes({', '.join(addresses)}, i64 %n) {{",
            "entry:",
            f"  %frame = alloca [{frame_bytes} x i8], align 8",
            f"  %table = alloca [{parameters} x ptr], align 8",
            f"  %m = addrspacecast ptr %frame to {POINTERS.frame}",
            f"  %p = addrspacecast ptr %table to {POINTERS.frame}",
            *table,
            *(f"  %{k} = call i32 {read.format(r)}" for k, r in registers.items()),
            "  %before = mul i32 %block, %threads",
            "  %lane = add i32 %before, %thread",
            "  %b = zext i32 %lane to i64",
            "  %is = icmp slt i64 %b, %n",
            "  br i1 %is, label %run, label %end",
            "run:",
            f"  call void @group({POINTERS.arguments()})",
            "  br label %end",
            "end:",
            "  ret void",
            "}",
        ]
    )


def _optimise(module: Any, machine: Any) -> None:
    llvm = _llvm()
    builder = llvm.create_pass_builder(machine, llvm.create_pipeline_tuning_options(1))
    builder.getModulePassManager().run(module, builder)


@functools.cache
def _llvm() -> Any:
    import llvmlite.binding

    llvmlite.binding.initialize_all_targets()
    llvmlite.binding.initialize_all_asmprinters()
    return llvmlite.binding


@functools.cache
def _libdevice() -> pathlib.Path:
    """NVIDIA's library of functions, from a wheel of theirs or CUDA's usual folder."""
    wheels = [pathlib.Path(p) / "nvidia" for p in sys.path if p]
    places = [w / part for w in wheels for part in ("cuda_nvcc", "cu13", "cu12")]
    for place in [*places, *sorted(pathlib.Path("/usr/local").glob("cuda*"))]:
        if (place / LIBDEVICE).exists():
            return place / LIBDEVICE
    raise NotImplementedError("where libdevice is: pip install nvidia-cuda-nvcc")
