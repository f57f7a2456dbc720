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
from jaxsim.lanes.code.emit import Emitter
from jaxsim.lanes.code.handler import handler, version
from jaxsim.lanes.code.machine import Loaded, lanes_of, llvm_version, object_code, processor
from jaxsim.lanes.code.schedule import Schedule
from jaxsim.lanes.identity import digest
from jaxsim.lanes.program.builder import Builder
from jaxsim.lanes.program.graph import INPUT
from jaxsim.lanes.program.types import DTYPES, code

# Width and code by name. What XLA knows by its address must stay until the process ends.
_REGISTERED: dict[str, tuple[int, Loaded]] = {}


@dataclasses.dataclass(frozen=True)
class Kernel:
    """A function that XLA can call by its name.

    Attributes:
      name: under which it is registered.
      width: lanes of a group; a batch has at least as many.
    """

    name: str
    width: int


@functools.lru_cache(maxsize=64)
def kernel(program, batched: tuple[bool, ...], single: bool = False) -> Kernel:
    """Compile a program of one lane.

    Args:
      program: a closed jaxpr.
      batched: which operands each lane has of its own.
      single: whether there is one lane only.

    Raises:
      NotImplementedError: the program has something that this compiler does not know, or this JAX
        has another interface.
    """
    if version() is None:
        raise NotImplementedError(f"the interface of XLA's custom calls in jax {jax.__version__}")
    key = _key(program, batched, single)
    name = f"jaxsim_lanes_{key}"
    if name not in _REGISTERED:
        stored = cache.load(key)
        if stored is None:
            text, width = source(program, batched, single)
            stored = width.to_bytes(1) + object_code(text)
            cache.save(key, stored)
        _REGISTERED[name] = stored[0], Loaded(stored[1:])
        capsule = ctypes.pythonapi.PyCapsule_New
        capsule.restype = ctypes.py_object
        capsule.argtypes = [ctypes.c_void_p, ctypes.c_char_p, ctypes.c_void_p]
        address = _REGISTERED[name][1].address("handler")
        target = capsule(address, b"xla._CUSTOM_CALL_TARGET", None)
        jax.ffi.register_ffi_target(name, target, platform="cpu")
    return Kernel(name, _REGISTERED[name][0])


def _key(program, batched: tuple[bool, ...], single: bool) -> str:
    """What machine code depends on: program, compiler, processor."""
    parts = digest(program), batched, single, _sources(), processor(), llvm_version(), version()
    return hashlib.sha256(repr(parts).encode()).hexdigest()[:32]


@functools.cache
def _sources() -> str:
    """Digest of this package, so that machine code of another release is not taken for its own."""
    files = sorted(pathlib.Path(__file__).parent.rglob("*.py"))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()


def source(program, batched: tuple[bool, ...], single: bool = False) -> tuple[str, int]:
    """LLVM's text of a program, and how many lanes its groups have."""
    graph, kinds, values = Builder(), [], []
    for k, (aval, own) in enumerate(zip(program.in_avals, batched, strict=True)):
        kind = code(aval.dtype)
        ids = graph.leaf(INPUT, kind, aval.size, k, uniform=not own)
        values.append(ids.reshape(aval.shape))
        kinds.append((kind, own))
    results = translate.evaluate(graph, forms.program(program), values)
    outputs = np.concatenate([np.zeros(0, np.int32), *[x.reshape(-1) for x in results]])
    schedule = Schedule(graph, outputs.astype(np.int32))
    width = 1 if single else lanes_of(_largest(graph, schedule.live))
    emitter = Emitter(schedule, kinds, results, width)
    text = emitter.module()
    parts = text, handler(len(kinds), len(results), width, emitter.frame_bytes)
    return "\n".join(parts), width


def _largest(graph: Builder, live: np.ndarray) -> int:
    """Bytes of the widest floating-point type that occurs; four without any."""
    kinds = np.unique(graph.type[: graph.size][live])
    return max([4, *[DTYPES[k].itemsize for k in kinds if DTYPES[k].kind == "f"]])
