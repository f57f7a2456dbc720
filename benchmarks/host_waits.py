"""Where a compiled program makes the host wait for a GPU, by the rules of XLA.

The host enqueues kernels and does not wait for them. It waits where it must read the condition of a
loop or the choice of a branch from the device, unless this is part of a command buffer, which the
device runs alone. XLA records in one what can be recorded and stands side by side, if that is at
least `SMALLEST` operations; a loop can be if all that it runs can. A loop that runs a known number
of times needs no answer. (`command_buffer_conversion_pass.cc` and `while_thunk.cc` of XLA.)
"""

import itertools

from hlo import FREE, Module, callees, is_a, kind, target, turns

# `xla_gpu_graph_min_graph_size`, which we leave as it is.
SMALLEST = 5
# What leaves the device.
HOST = "Infeed", "Outfeed", "Send", "Recv", "SendDone", "RecvDone"
HOST_MEMORY = "S(5)"
# What runs on the device but cannot be recorded.
UNRECORDED = "Fft", "Cholesky", "TriangularSolve"
# Calls that say that they may be recorded: ours (`lanes.gpu.launcher.RECORDABLE`), cuBLAS, and
# factorisations and random bits of jaxlib.
RECORDED = "jaxsim_lanes_", "__cublas$", "cusolver_", "cublas_", "cu_threefry2x32"


def host_waits(compiled) -> list[str]:
    """What the host waits for in a program whose loops may be recorded, and what it must do itself.

    Args:
      compiled: a program, compiled with `jaxsim.parallel.devices.compiler_options("gpu")`.
    """
    module = Module(compiled)
    return _Rules(module).waits(module.entry)


class _Rules:
    def __init__(self, module: Module):
        self.module = module

    def waits(self, computation: str) -> list[str]:
        """Those of a computation, after what can be recorded is."""
        found = []
        launched = (i for i in self.module.instructions(computation) if not is_a(i, *FREE))
        for recorded, group in itertools.groupby(launched, self._recordable):
            instructions = list(group)
            if not recorded:
                found += [w for i in instructions for w in self._alone(i, self.waits)]
            elif len(instructions) < SMALLEST:
                found += [w for i in instructions for w in self._alone(i, self._plain)]
        return found

    def _plain(self, computation: str) -> list[str]:
        """Those of a computation in which nothing is recorded."""
        return [
            w for i in self.module.instructions(computation) for w in self._alone(i, self._plain)
        ]

    def _alone(self, instruction, inside) -> list[str]:
        """Those of an instruction that is not recorded, and of what it runs."""
        asks = is_a(instruction, "Conditional")
        asks |= is_a(instruction, "While") and turns(instruction) is None
        called = self._called(instruction)
        return [instruction.name] * (asks or _leaves(instruction)) + [
            w for name in called for w in inside(name)
        ]

    def _recordable(self, instruction) -> bool:
        if is_a(instruction, "CustomCall"):
            return target(instruction).startswith(RECORDED)
        called = [i for name in self._called(instruction) for i in self.module.instructions(name)]
        return not (_leaves(instruction) or is_a(instruction, *UNRECORDED)) and all(
            map(self._recordable, called)
        )

    def _called(self, instruction) -> list[str]:
        """Computations that a loop or a branch runs."""
        if not is_a(instruction, "While", "Conditional"):
            return []
        return list(itertools.chain.from_iterable(callees(instruction).values()))


def _leaves(instruction) -> bool:
    """Whether the host does it, or it moves data to or from the host."""
    if is_a(instruction, "CustomCall") and "callback" in target(instruction):
        return True
    if is_a(instruction, *HOST):
        return True
    return not is_a(instruction, *FREE) and HOST_MEMORY in kind(instruction)
