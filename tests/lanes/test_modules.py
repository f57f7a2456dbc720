"""Programs in several modules: on a CPU they are the program; NVIDIA's tools link them."""

import pickle
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax import lax

pytest.importorskip("llvmlite")

import llvmlite.binding as llvm

from jaxsim import lanes
from jaxsim.lanes import compiler
from jaxsim.lanes.code import machine
from jaxsim.lanes.gpu import assembler, ptx
from jaxsim.lanes.gpu.modules import divide

SHORT = 20  # operations of a piece


def f(x):
    """Loops, branches, a table and functions of the library, in many pieces."""
    table = jnp.sin(jnp.arange(7, dtype=x.dtype))
    y = lax.while_loop(lambda y: y @ y < 9, lambda y: y * 1.5 + x[::-1], x)
    y = y + lax.cond(x[0] > 0, lambda: jnp.cos(x), lambda: jnp.exp(x))
    solved = jnp.linalg.inv(jnp.eye(3, dtype=x.dtype) + jnp.outer(x, x)) @ y
    return solved + table[jnp.clip(x.astype(int), 0, 6)]


class Together:
    """Object files of several modules, linked in memory."""

    def __init__(self, codes: bytes):
        self.engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine._target())
        for code in pickle.loads(codes):
            self.engine.add_object_file(llvm.ObjectFileRef.from_data(code))
        self.engine.finalize_object()

    def address(self, name):
        return self.engine.get_function_address(name)


def test_modules_together_are_the_program(monkeypatch):
    made, counts = compiler._emitter, []

    def objects(text):
        counts.append(len(divide(text, 4)))
        return pickle.dumps([machine.object_code(part) for part in divide(text, 4)])

    monkeypatch.setattr(compiler, "_emitter", lambda *a: made(*a, longest=SHORT))
    monkeypatch.setattr(compiler, "_sources", lambda: "in modules")
    monkeypatch.setattr(compiler.cache, "load", lambda key: None)
    monkeypatch.setattr(compiler.cache, "save", lambda key, code: None)
    monkeypatch.setattr(compiler, "object_code", objects)
    monkeypatch.setattr(compiler, "Loaded", Together)
    x = jnp.asarray(np.random.default_rng(0).normal(size=(40, 3)), jnp.float32)
    np.testing.assert_allclose(
        jax.jit(jax.vmap(lanes.as_kernel(f)))(x), jax.vmap(f)(x), rtol=2e-5, atol=2e-5
    )
    assert counts == [4]


def modules(count):
    """PTX of the program in modules."""
    program = jax.make_jaxpr(f)(jnp.ones(3))
    emitter = compiler._emitter(program, (True,), False, 1, ptx.POINTERS, SHORT)
    text = ptx.program(emitter, 2)
    defined = re.findall(r"^define [^@]*@(\w+)", text, re.MULTILINE)
    parts = divide(text, count)
    assert sorted(defined) == sorted(
        name for part in parts for name in re.findall(r"^define [^@]*@(\w+)", part, re.MULTILINE)
    )
    return [ptx.ptx(part, 90) for part in parts]


def test_nvidias_tools_link_them():
    """The program of machine code has the kernel, and it lacks no function."""
    if None in assembler._tools():
        pytest.skip("NVIDIA's assembler and linker are not installed")
    code = assembler.machine_code(modules(4), 90)
    assert code is not None
    assert code.startswith(b"\x7fELF")
    assert b".text.lanes\0" in code
    assert assembler.machine_code(modules(4)[1:], 90) is None, "a function is missing"


def test_without_the_tools(monkeypatch):
    monkeypatch.setattr(assembler, "_tools", lambda: (None, None))
    assert assembler.machine_code([".version 7.8"], 90) is None
