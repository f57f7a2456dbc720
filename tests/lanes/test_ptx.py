"""PTX of a program, made without a GPU; it is run where there is one, by `benchmarks/gpu.py`."""

import pathlib
import re

import jax
import jax.numpy as jnp
import pytest
from jax import lax

pytest.importorskip("llvmlite")

from jaxsim.lanes import compiler
from jaxsim.lanes.gpu import driver, ptx


def text(f, *args, longest=ptx.LONGEST):
    program = jax.make_jaxpr(f)(*args)
    batched = (True,) * len(program.in_avals)
    emitter = compiler._emitter(program, batched, False, 1, ptx.POINTERS, longest)
    return ptx.ptx(ptx.program(emitter, len(program.in_avals) + len(program.out_avals)), 90)


def loop(x):
    return lax.while_loop(lambda y: y @ y < 9, lambda y: y * jnp.float32(1.5) + x[::-1], x)


def test_entry():
    """One parameter for each array and one for the number of lanes; arrays in global memory."""
    found = text(lambda x, y: (loop(x) / y, x[0] > 0), jnp.ones(3), jnp.float32(2))
    entry = re.search(r"\.visible \.entry lanes\((.*?)\)", found, re.DOTALL)
    assert entry is not None
    assert entry[1].count(".param") == 2 + 2 + 1
    assert len(re.findall(r"ld\.global[.\w]*b32", found)) >= 3 + 1
    assert len(re.findall(r"st\.global[.\w]*b32", found)) == 3
    assert len(re.findall(r"st\.global[.\w]*b8", found)) == 1
    assert ".extern" not in found


def test_pieces():
    """What one piece leaves for another is in local memory, and in no other."""
    f = lambda x: jnp.linalg.inv(jnp.eye(3) + jnp.outer(x, x)) @ x  # noqa: E731
    whole, parts = (text(f, jnp.ones(3), longest=n) for n in (ptx.LONGEST, 20))
    assert parts.count("ld.local.b32") > whole.count("ld.local.b32")
    assert not re.search(r"\b(ld|st)\.[bf]\d", parts)


def test_functions_of_the_c_library():
    """Those of libdevice become part of the program."""
    try:
        ptx._libdevice()
    except NotImplementedError as reason:
        pytest.skip(str(reason))
    found = text(lambda x: jnp.sin(x) + x ** jnp.float32(0.3), jnp.ones(3))
    assert ".extern" not in found
    assert "__cudart_i2opi_f" in found, "digits of 2 / pi, by which it reduces large angles"


def test_no_libdevice(monkeypatch):
    def missing():
        raise NotImplementedError("where libdevice is")

    monkeypatch.setattr(ptx, "_libdevice", missing)
    with pytest.raises(NotImplementedError, match="libdevice"):
        text(jnp.sin, jnp.ones(3))


@pytest.mark.skipif(pathlib.Path("/proc/driver/nvidia").exists(), reason="there is a driver")
def test_no_driver():
    with pytest.raises(NotImplementedError, match="driver"):
        driver.Loaded(b".version 7.8\0")
