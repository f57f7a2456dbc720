"""A name for a traced program that is the same in every process."""

import hashlib
import re
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend import core as jex

ADDRESS = re.compile(r" at 0x[0-9a-f]+")


def digest(program: Any) -> str:
    """Hexadecimal digest of the equations and constants of a closed jaxpr.

    Programs with equal digests compute the same. Functions among the parameters of equations are
    rules for derivatives, which are the same where the program inside the equation is the same.
    """
    found = hashlib.sha256()
    _closed(program, found)
    return found.hexdigest()


def _closed(program: Any, found) -> None:
    for value in getattr(program, "consts", ()):
        _value(value, found)
    _open(getattr(program, "jaxpr", program), found)


def _open(jaxpr: Any, found) -> None:
    numbers: dict[Any, int] = {}

    def name(atom) -> bytes:
        if isinstance(atom, jex.Literal):
            value = np.asarray(atom.val, atom.aval.dtype)
            return b"l%s%s" % (value.dtype.str.encode(), value.tobytes())
        return b"v%d" % numbers.setdefault(atom, len(numbers))

    for v in [*jaxpr.constvars, *jaxpr.invars]:
        found.update(name(v) + str(v.aval).encode())
    for eqn in jaxpr.eqns:
        found.update(eqn.primitive.name.encode())
        for key in sorted(eqn.params):
            found.update(key.encode())
            _value(eqn.params[key], found)
        found.update(b"(" + b",".join(map(name, eqn.invars)) + b")")
        for v in eqn.outvars:
            found.update(name(v) + str(v.aval).encode())
    found.update(b"=" + b",".join(map(name, jaxpr.outvars)))


def _value(value: Any, found) -> None:
    """A constant or a parameter of an equation."""
    if hasattr(value, "eqns"):  # a closed jaxpr or an open one
        _closed(value, found)
    elif isinstance(value, tuple | list):
        found.update(b"[")
        for item in value:
            _value(item, found)
        found.update(b"]")
    elif isinstance(value, np.ndarray | np.generic | jax.Array):
        value = _numbers(value)
        array = np.asarray(value)
        found.update(f"{array.dtype}{array.shape}".encode() + array.tobytes())
    else:
        found.update(ADDRESS.sub("", repr(value)).encode())


def _numbers(value: Any) -> Any:
    """An array; of random keys, their data."""
    is_key = jnp.issubdtype(value.dtype, jax.dtypes.prng_key)
    return jax.random.key_data(value) if is_key else value
