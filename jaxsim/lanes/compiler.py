"""The pipeline: a traced program to a function that XLA can call."""

import ctypes
import dataclasses
import functools
import hashlib
import pathlib

import jax
import numpy as np

from jaxsim.batching import forms
from jaxsim.lanes import rules, translate  # noqa: F401
from jaxsim.lanes.code import cache
from jaxsim.lanes.code.emit import CPU, Emitter, Pointers
from jaxsim.lanes.code.handler import handler, version
from jaxsim.lanes.code.machine import Loaded, lanes_of, llvm_version, object_code, processor
from jaxsim.lanes.code.schedule import PIECE, Schedule
from jaxsim.lanes.gpu import driver, ptx
from jaxsim.lanes.gpu.launcher import launcher
from jaxsim.lanes.identity import digest
from jaxsim.lanes.program.builder import Builder
from jaxsim.lanes.program.graph import INPUT
from jaxsim.lanes.program.types import DTYPES, code

# Kernels by name, with their code: what XLA knows by its address must stay until the process ends.
_REGISTERED: dict[str, tuple["Kernel", tuple]] = {}


@dataclasses.dataclass(frozen=True)
class Kernel:
    """A function that XLA can call by its name.

    Attributes:
      name: under which it is registered.
      width: lanes of a group; a batch has at least as many. One on a GPU.
    """

    name: str
    width: int


# The values of a group of lanes are on the stack, of which a thread often has 8 MB.
LARGEST_FRAME = 2**22


@functools.lru_cache(maxsize=64)
def kernel(
    program, batched: tuple[bool, ...], finite_math: bool = False, *, single: bool = False
) -> Kernel:
    """Compile a program of one lane for this machine's CPU.

    Args:
      program: a closed jaxpr.
      batched: which operands each lane has of its own.
      finite_math: as for `as_kernel`.
      single: whether there is one lane only.

    Raises:
      NotImplementedError: the program has something that this compiler does not know, or this JAX
        has another interface.
    """
    key = _key(program, batched, finite_math, single, processor())
    if key not in _REGISTERED:
        stored = cache.load(key)
        if stored is None:
            text, width = source(program, batched, finite_math, single=single)
            stored = width.to_bytes(1) + object_code(text)
            cache.save(key, stored)
        _register(key, stored[0], "cpu", Loaded(stored[1:]))
    return _REGISTERED[key][0]


@functools.lru_cache(maxsize=64)
def gpu_kernel(program, batched: tuple[bool, ...], finite_math: bool, capability: int) -> Kernel:
    """Compile a program of one lane for GPUs of CUDA, a thread for each lane.

    Args:
      program: a closed jaxpr.
      batched: which operands each lane has of its own.
      finite_math: as for `as_kernel`.
      capability: of the devices, 90 for 9.0.

    Raises:
      NotImplementedError: as `kernel`, or there is no driver or no libdevice.
    """
    key = _key(program, batched, finite_math, "gpu", capability)
    if key not in _REGISTERED:
        count = len(program.in_avals), len(program.out_avals)
        stored = cache.load(key)
        if stored is None:
            emitter = _emitter(program, batched, finite_math, 1, ptx.POINTERS, ptx.LONGEST)
            stored = ptx.code(emitter, sum(count), capability)
            cache.save(key, stored)
        device = driver.Loaded(stored)
        host = object_code(launcher(*count, device.address, device.launch))
        _register(key, 1, "CUDA", Loaded(host), device)
    return _REGISTERED[key][0]


def _register(key: str, width: int, platform: str, *loaded) -> None:
    """Tell XLA the address of the handler, which is in the first of the codes."""
    made = Kernel(f"jaxsim_lanes_{key}", width)
    capsule = ctypes.pythonapi.PyCapsule_New
    capsule.restype = ctypes.py_object
    capsule.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
    target = capsule(loaded[0].address("handler"), b"xla._CUSTOM_CALL_TARGET", None)
    jax.ffi.register_ffi_target(made.name, target, platform=platform)
    _REGISTERED[key] = made, loaded


def _key(program, batched: tuple[bool, ...], *target) -> str:
    """What machine code depends on: program, compiler, processor."""
    if version() is None:
        raise NotImplementedError(f"the interface of XLA's custom calls in jax {jax.__version__}")
    parts = digest(program), batched, target, _sources(), llvm_version(), version()
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


@functools.cache
def _sources() -> str:
    """Digest of this package, so that machine code of another release is not taken for its own."""
    files = sorted(pathlib.Path(__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def source(
    program, batched: tuple[bool, ...], finite_math: bool = False, *, single: bool = False
) -> tuple[str, int]:
    """LLVM's text of a program for a CPU, and how many lanes its groups have."""
    emitter = _emitter(program, batched, finite_math, 1 if single else None)
    if emitter.frame_bytes > LARGEST_FRAME:
        raise NotImplementedError(
            f"programs that keep {emitter.frame_bytes / 1e6:.0f} MB of values"
        )
    count = len(program.in_avals), len(program.out_avals)
    text = emitter.module(), handler(*count, emitter.width, emitter.frame_bytes)
    return "\n".join(text), emitter.width


def _emitter(
    program,
    batched,
    finite_math: bool,
    width: int | None,
    pointers: Pointers = CPU,
    longest: int = PIECE,
) -> Emitter:
    """A program in the compiler's own terms and in order.

    Args:
      program: a closed jaxpr.
      batched: which operands each lane has of its own.
      finite_math: as for `as_kernel`.
      width: lanes of a group; None for those of a vector.
      pointers: types of addresses.
      longest: operations of a piece, at most.
    """
    graph, kinds, values = Builder(finite_math, pointers is CPU), [], []
    alone = width == 1 and pointers is CPU
    for k, (aval, own) in enumerate(zip(program.in_avals, batched, strict=True)):
        kind = code(aval.dtype)
        ids = graph.leaf(INPUT, kind, aval.size, k, uniform=alone or not own)
        values.append(ids.reshape(aval.shape))
        kinds.append((kind, own))
    results = translate.evaluate(graph, forms.program(program), values)
    outputs = np.concatenate([np.zeros(0, np.int32), *[x.reshape(-1) for x in results]])
    schedule = Schedule(graph, outputs.astype(np.int32), longest)
    width = width or lanes_of(_largest(graph, schedule.live))
    return Emitter(schedule, kinds, results, width, pointers)


def _largest(graph: Builder, live: np.ndarray) -> int:
    """Bytes of the widest floating-point type that occurs; four without any."""
    kinds = np.unique(graph.type[: graph.size][live])
    return max([4, *[DTYPES[k].itemsize for k in kinds if DTYPES[k].kind == "f"]])
