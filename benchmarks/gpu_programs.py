"""Programs compiled for an H100, on a machine that need not have one: rollouts and PPO's epochs.

Nothing is run and no time is measured. Counted are the kernels of a step, which cost a few
microseconds each however small they are, the calls of libraries, the bytes that kernels read and
write, which the memory's bandwidth bounds, the memory between kernels, and where the host has to
wait for the device. Bodies of inner loops count once. The candidates are jaxsim with one kernel for
a step, with the lanes last (`jaxsim.vmap`) and with the lanes first (`jax.vmap`), and MJX. Of an
epoch of training, all launches are counted. JAX's compiler for CUDA must be installed: `pip install
"jax[cuda12]"`.
"""

import functools
import itertools
import os

import common
import models
from described import compile_for_device, pretended
from hlo import FREE, Module, callees, is_a, size, target, turns
from host_waits import host_waits

STEPS = 10
TASKS = ["half_cheetah", "hopper", "humanoid"]
PEERS = ("kernel", "lanes last", "lanes first", "MJX")
KERNEL = "jaxsim_lanes_"
NESTING = "While", "Conditional"
VIEWS = "Slice", "DynamicSlice", "Gather"


def main(arguments=None) -> None:
    parser = common.parser(__doc__, repetitions=1)
    small = ["ant", "half_cheetah", "hopper", "walker2d", "double_pendulum"]
    usual = ["humanoid", *small, "gymnasium_humanoid"]
    parser.add_argument("--models", nargs="*", default=usual, choices=models.MODELS)
    parser.add_argument("--peers", nargs="+", default=PEERS, choices=PEERS)
    parser.add_argument("--batch", type=int, default=8192, help="environments")
    parser.add_argument("--tasks", nargs="*", default=TASKS, help="trained by PPO")
    options = parser.parse_args(arguments)
    os.environ["JAX_PLATFORMS"] = "cpu"  # constants are kept there
    # To time alternatives takes a device.
    os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_gpu_autotune_level=0"
    rows, epochs = [], []
    with pretended():
        for name in options.models:
            mj = models.load(name)
            found = [{"model": name} | _row(mj, peer, options.batch) for peer in options.peers]
            print(common.table(found), flush=True)
            rows += found
        for task in options.tasks:
            epochs.append({"task": task} | _epoch_row(task))
            print(common.table(epochs[-1:]), flush=True)
    record = {"batch": options.batch, "device": "h100", "rows": rows, "epochs": epochs}
    common.write(options, __file__, record, lambda figure: _draw(figure, rows))


def _row(mj, peer: str, batch: int) -> dict:
    from jaxsim.lanes.switch import enable_lanes

    enable_lanes(peer == "kernel")
    try:
        f, args = _mjx(mj, batch) if peer == "MJX" else _jaxsim(mj, batch, peer)
    except NotImplementedError as error:
        return {"by": peer, "why": str(error)}
    compiled, seconds = compile_for_device(f, *args, ours=peer != "MJX")
    step = Program(compiled)
    return {
        "by": peer,
        "kernels": len(step.kernels),
        "kB": step.size(step.kernels) / batch / 1e3,
        "library calls": len(step.calls),
        "inner kernels": len(step.inner),
        "inner kB": step.size(step.inner) / batch / 1e3,
        "temporary kB": compiled.memory_analysis().temp_size_in_bytes / batch / 1e3,
        "host waits": len(host_waits(compiled)) if peer != "MJX" else None,
        "compile s": seconds,
    }


def _epoch_row(task: str) -> dict:
    """An epoch of PPO with the settings for a GPU, and the evaluation after it."""
    from described import compile_training

    algorithm, epoch, evaluation, seconds = compile_training("ppo", task)
    return {
        "by": "PPO",
        "envs": algorithm.config.envs,
        "steps": algorithm.steps_per_epoch,
        "launches": launches(epoch),
        "host waits": len(host_waits(epoch)),
        "in evaluations": len(host_waits(evaluation)),
        "compile s": seconds,
    }


def launches(compiled) -> int:
    """All kernels and calls of a program; both branches of a choice, unknown loops once."""
    module = Module(compiled)

    def count(computation: str) -> int:
        total = 0
        for i in module.instructions(computation):
            inside = [n for names in callees(i).values() for n in names]
            if is_a(i, *NESTING):
                total += (turns(i) or 1 if is_a(i, "While") else 1) * sum(map(count, inside))
            elif not is_a(i, *FREE):
                total += 1
        return total

    return count(module.entry)


def _jaxsim(mj, batch: int, peer: str):
    import jax
    import jax.numpy as jnp

    import jaxsim

    model = jaxsim.load(mj)
    rollout = _rollout(functools.partial(jaxsim.step, model))
    states = models.repeated(jaxsim.make_state(model), batch)
    vmap = jax.vmap if peer == "lanes first" else jaxsim.vmap
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


class Program:
    """What the loop of a compiled rollout launches at each turn.

    Attributes:
      kernels: fused operations, our own kernels, copies and the like.
      inner: those in inner loops and branches.
      calls: routines of libraries, everywhere.
    """

    def __init__(self, compiled):
        self._module = Module(compiled)
        loops = [i for i in self._module.instructions(self._module.entry) if is_a(i, "While")]
        (rollout,) = (i for i in loops if turns(i) == STEPS)
        outer = self._module.instructions(callees(rollout)["body"][0])
        inner = [i for o in outer if is_a(o, *NESTING) for i in self._called(o)]
        self.calls = [i for i in (*outer, *inner) if _is_library_call(i)]
        self.kernels, self.inner = (
            [i for i in group if not (is_a(i, *FREE, *NESTING) or _is_library_call(i))]
            for group in (outer, inner)
        )

    def size(self, kernels) -> int:
        """Bytes that are read and written; of operands only the parts that are read."""
        return sum(size(kernel) + self._read(kernel) for kernel in kernels)

    def _called(self, instruction) -> list:
        """All that an instruction runs, nested loops and branches included."""
        found = []
        for name in itertools.chain.from_iterable(callees(instruction).values()):
            for i in self._module.instructions(name):
                found += [i, *self._called(i)] if is_a(i, *NESTING) else [i]
        return found

    def _read(self, instruction) -> int:
        """Bytes of the operands, or of those parts of them that are read."""
        if not is_a(instruction, "Fusion"):
            return sum(map(size, instruction.operands()))
        total = 0
        for inner in self._module.fused(instruction):
            if is_a(inner, "Parameter"):
                parts = [size(user) for user in inner.users() if is_a(user, *VIEWS)]
                whole = len(parts) < len(inner.users())
                total += size(inner) if whole else min(size(inner), sum(parts))
        return total


def _is_library_call(instruction) -> bool:
    return is_a(instruction, "CustomCall") and not target(instruction).startswith(KERNEL)


def _draw(figure, rows) -> None:
    """Kernels and bytes of each candidate, those of inner loops on top."""
    rows = [r for r in rows if "why" not in r]
    if not rows:
        return
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
