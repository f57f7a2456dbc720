"""Rollouts compiled for an H100, on a machine that need not have one: what a step consists of.

Nothing is run and no time is measured. Counted are the kernels of a step, which cost a few
microseconds each however small they are, the calls of libraries, the bytes that kernels read and
write, which the memory's bandwidth bounds, and the memory between kernels. Bodies of inner loops
count once. The candidates are jaxsim with the lanes last (`jaxsim.vmap`) and with the lanes first
(`jax.vmap`), and MJX. JAX's compiler for CUDA must be installed: `pip install "jax[cuda12]"`.
"""

import functools
import itertools
import math
import os
import pathlib
import re
import time

import common
import models

DEVICE = pathlib.Path(__file__).parent / "h100.pbtxt"
STEPS = 10
PEERS = ("lanes last", "lanes first", "MJX")
# Instructions that launch nothing.
FREE = "Parameter", "Constant", "Tuple", "GetTupleElement", "Bitcast", "AfterAll"
NESTING = "While", "Conditional"
VIEWS = "Slice", "DynamicSlice", "Gather"
BYTES = {"pred": 1, "s8": 1, "u8": 1, "s32": 4, "u32": 4, "f32": 4, "s64": 8, "u64": 8, "f64": 8}


def main(arguments=None) -> None:
    parser = common.parser(__doc__, repetitions=1)
    small = ["ant", "half_cheetah", "hopper", "walker2d", "double_pendulum"]
    usual = ["humanoid", *small, "gymnasium_humanoid"]
    parser.add_argument("--models", nargs="+", default=usual, choices=models.MODELS)
    parser.add_argument("--peers", nargs="+", default=PEERS, choices=PEERS)
    parser.add_argument("--batch", type=int, default=8192, help="environments")
    options = parser.parse_args(arguments)
    os.environ["JAX_PLATFORMS"] = "cpu"  # constants are kept there
    # To time alternatives takes a device.
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_gpu_autotune_level=0"
    rows = []
    for name in options.models:
        mj = models.load(name)
        found = [{"model": name} | _row(mj, peer, options.batch) for peer in options.peers]
        print(common.table(found), flush=True)
        rows += found
    record = {"batch": options.batch, "device": DEVICE.stem, "rows": rows}
    common.write(options, __file__, record, lambda figure: _draw(figure, rows))


def _row(mj, peer: str, batch: int) -> dict:
    try:
        f, args = _mjx(mj, batch) if peer == "MJX" else _jaxsim(mj, batch, last=peer == PEERS[0])
    except NotImplementedError as error:
        return {"by": peer, "why": str(error)}
    compiled, seconds = compile_for_device(f, *args)
    step = Program(compiled)
    return {
        "by": peer,
        "kernels": len(step.kernels),
        "kB": step.size(step.kernels) / batch / 1e3,
        "library calls": len(step.calls),
        "inner kernels": len(step.inner),
        "inner kB": step.size(step.inner) / batch / 1e3,
        "temporary kB": compiled.memory_analysis().temp_size_in_bytes / batch / 1e3,
        "compile s": seconds,
    }


def _jaxsim(mj, batch: int, last: bool):
    import jax
    import jax.numpy as jnp

    import jaxsim

    model = jaxsim.load(mj)
    rollout = _rollout(functools.partial(jaxsim.step, model))
    states = models.repeated(jaxsim.make_state(model), batch)
    vmap = jaxsim.vmap if last else jax.vmap
    return vmap(rollout), (states, jnp.zeros((batch, STEPS, mj.nu)))


def _mjx(mj, batch: int):
    import jax
    import jax.numpy as jnp
    from mujoco import mjx

    model, data = mjx.put_model(mj, impl="jax"), mjx.make_data(mj, impl="jax")
    rollout = _rollout(lambda d, u: mjx.step(model, d.replace(ctrl=u)))
    return jax.vmap(rollout), (models.repeated(data, batch), jnp.zeros((batch, STEPS, mj.nu)))


def _rollout(step):
    import jax

    return lambda state, ctrls: jax.lax.scan(lambda s, u: (step(s, u), None), state, ctrls)[0]


def compile_for_device(f, *args):
    """The program of f for the described device, and the seconds that it took."""
    import jax
    from jax.experimental import topologies

    described = {"target_config": DEVICE.read_text(), "topology": "1x1x1"}
    try:
        device = topologies.get_topology_desc("", "cuda", **described).devices[0]
    except NotImplementedError:
        raise SystemExit('XLA cannot compile for CUDA here: pip install "jax[cuda12]"') from None
    there = jax.sharding.SingleDeviceSharding(device)
    kind = lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=there)  # noqa: E731
    start = time.perf_counter()
    compiled = jax.jit(f).lower(*jax.tree.map(kind, args)).compile()
    return compiled, time.perf_counter() - start


class Program:
    """What the loop of a compiled rollout launches at each turn.

    Attributes:
      kernels: fused operations, copies and the like.
      inner: those in inner loops and branches.
      calls: routines of libraries, everywhere.
    """

    def __init__(self, compiled):
        (module,) = compiled.runtime_executable().hlo_modules()
        self._computations = {c.name: c.instructions() for c in module.computations()}
        entry = re.search(r"^ENTRY %?([\w.\-]+)", module.to_string(), re.MULTILINE)[1]
        loops = [i for i in self._computations[entry] if _is(i, "While")]
        (rollout,) = (i for i in loops if f'"n":"{STEPS}"' in i.to_string())
        outer = self._instructions(_callees(rollout)["body"][0])
        inner = [i for o in outer if _is(o, *NESTING) for i in self._called(o)]
        self.calls = [i for i in (*outer, *inner) if _is(i, "CustomCall")]
        self.kernels, self.inner = (
            [i for i in group if not _is(i, "CustomCall", *FREE, *NESTING)]
            for group in (outer, inner)
        )

    def size(self, kernels) -> int:
        """Bytes that are read and written; of operands only the parts that are read."""
        return sum(_size(kernel) + self._read(kernel) for kernel in kernels)

    def _instructions(self, computation: str) -> list:
        """Those of a computation, with those of functions that it calls."""
        found = []
        for i in self._computations[computation]:
            found += self._called(i) if _is(i, "Call") else [i]
        return found

    def _called(self, instruction) -> list:
        """All that an instruction runs, nested loops and branches included."""
        found = []
        for name in itertools.chain.from_iterable(_callees(instruction).values()):
            for i in self._instructions(name):
                found += [i, *self._called(i)] if _is(i, *NESTING) else [i]
        return found

    def _read(self, instruction) -> int:
        """Bytes of the operands, or of those parts of them that are read."""
        if not _is(instruction, "Fusion"):
            return sum(map(_size, instruction.operands()))
        (fused,) = _callees(instruction)["calls"]
        total = 0
        for inner in self._computations[fused]:
            if _is(inner, "Parameter"):
                parts = [_size(user) for user in inner.users() if _is(user, *VIEWS)]
                whole = len(parts) < len(inner.users())
                total += _size(inner) if whole else min(_size(inner), sum(parts))
        return total


def _is(instruction, *opcodes: str) -> bool:
    return instruction.opcode.name.removeprefix("k") in opcodes


def _callees(instruction) -> dict[str, list[str]]:
    """Names of the computations that an instruction runs, by the attribute that names them."""
    named = r"(body|condition|calls|to_apply|\w+_computations?)=(\{[^}]*\}|%[\w.\-]+)"
    found = re.findall(named, instruction.to_string())
    return {key: re.findall(r"%([\w.\-]+)", names) for key, names in found}


def _size(instruction) -> int:
    """Bytes of a result."""
    kind = re.search(r" = (.*?) [\w\-]+\(", instruction.to_string())[1]
    arrays = re.findall(r"(\w+)\[([\d,]*)\]", kind)
    return sum(BYTES[t] * math.prod(int(n) for n in dims.split(",") if n) for t, dims in arrays)


def _draw(figure, rows) -> None:
    """Kernels and bytes of each candidate, those of inner loops on top."""
    rows = [r for r in rows if "why" not in r]
    names = list(dict.fromkeys(r["model"] for r in rows))
    peers = list(dict.fromkeys(r["by"] for r in rows))
    width = 0.8 / len(peers)
    labels = {"kernels": "kernels of a step", "kB": "kB read and written for an environment"}
    for axes, column in zip(figure.subplots(1, len(labels)), labels, strict=True):
        for i, peer in enumerate(peers):
            line = [r for r in rows if r["by"] == peer]
            at = [names.index(r["model"]) + width * (i - (len(peers) - 1) / 2) for r in line]
            bars = axes.bar(at, [r[column] for r in line], width, label=peer)
            inner = [r[f"inner {column}"] for r in line]
            colour = bars[0].get_facecolor()
            axes.bar(at, inner, width, [r[column] for r in line], color=colour, alpha=0.4)
        axes.set_xticks(range(len(names)), names, fontsize=7, rotation=20, ha="right")
        axes.set_ylabel(labels[column])
    axes.legend(fontsize=7, title="pale: inner loops")


if __name__ == "__main__":
    main()
