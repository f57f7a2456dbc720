"""Types of scalars: NumPy's dtypes by small numbers, and what LLVM calls them."""

import numpy as np

DTYPES = tuple(
    np.dtype(name)
    for name in "bool int8 uint8 int16 uint16 int32 uint32 int64 uint64 float32 float64".split()
)
CODES = {dtype: code for code, dtype in enumerate(DTYPES)}
BOOL, INT32 = CODES[np.dtype(bool)], CODES[np.dtype("int32")]


def code(dtype) -> int:
    """The number of a dtype.

    Raises:
      NotImplementedError: there are no lanes of such numbers.
    """
    found = CODES.get(dtype) if isinstance(dtype, np.dtype) else None
    if found is None:
        raise NotImplementedError(f"numbers of type {dtype}")
    return found


def scalar_name(code: int) -> str:
    """LLVM's name of the type in registers; a truth value is one bit."""
    dtype = DTYPES[code]
    if dtype.kind == "f":
        return "float" if dtype.itemsize == 4 else "double"
    return "i1" if dtype.kind == "b" else f"i{8 * dtype.itemsize}"


def vector_name(scalar: str, width: int) -> str:
    """`width` such scalars; one is the scalar itself."""
    return scalar if width == 1 else f"<{width} x {scalar}>"


def literal(value, code: int) -> str:
    """A constant in LLVM's text; floats are the bits of a double."""
    dtype = DTYPES[code]
    if dtype.kind == "f":
        return f"0x{int(np.float64(value).view(np.uint64)):016X}"
    return str(int(value)) if dtype.kind != "b" else ("true" if value else "false")
