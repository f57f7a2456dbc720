"""Compiled programs as XLA writes them down: their computations, and what an instruction is."""

import math
import re

# Instructions that launch nothing.
FREE = "Parameter", "Constant", "Tuple", "GetTupleElement", "Bitcast", "AfterAll", "PartitionId"
BYTES = {"pred": 1, "s8": 1, "u8": 1, "s32": 4, "u32": 4, "f32": 4, "s64": 8, "u64": 8, "f64": 8}


class Module:
    """The computations of a compiled program, by name.

    Attributes:
      entry: name of the one that runs first.
    """

    def __init__(self, compiled):
        (module,) = compiled.runtime_executable().hlo_modules()
        self._computations = {c.name: c.instructions() for c in module.computations()}
        self.entry = re.search(r"^ENTRY %?([\w.\-]+)", module.to_string(), re.MULTILINE)[1]

    def fused(self, fusion) -> list:
        """Instructions inside a fusion."""
        return self._computations[callees(fusion)["calls"][0]]

    def instructions(self, computation: str) -> list:
        """Those of a computation, with those of functions that it calls."""
        found = []
        for i in self._computations[computation]:
            called = callees(i)["to_apply"] if is_a(i, "Call") else []
            found += self.instructions(called[0]) if called else [i]
        return found


def is_a(instruction, *opcodes: str) -> bool:
    """Whether its opcode is one of these."""
    return instruction.opcode.name.removeprefix("k") in opcodes


def callees(instruction) -> dict[str, list[str]]:
    """Names of the computations that an instruction runs, by the attribute that names them."""
    named = r"(body|condition|calls|to_apply|\w+_computations?)=(\{[^}]*\}|%[\w.\-]+)"
    found = re.findall(named, instruction.to_string())
    return {key: re.findall(r"%([\w.\-]+)", names) for key, names in found}


def turns(loop) -> int | None:
    """How often a loop runs its body, where XLA knows."""
    found = re.search(r'"known_trip_count":\{"n":"(\d+)"', loop.to_string())
    return int(found[1]) if found else None


def target(call) -> str:
    """The function that a custom call calls."""
    return re.search(r'custom_call_target="([^"]*)"', call.to_string())[1]


def kind(instruction) -> str:
    """Type, shape and layout of a result."""
    return re.search(r" = (.*?) [\w\-]+\(", instruction.to_string())[1]


def size(instruction) -> int:
    """Bytes of a result."""
    arrays = re.findall(r"(\w+)\[([\d,]*)\]", kind(instruction))
    return sum(BYTES[t] * math.prod(int(n) for n in dims.split(",") if n) for t, dims in arrays)
