"""CUDA's driver by ctypes: PTX or machine code becomes a kernel with an address."""

import ctypes
import functools
from typing import Any

import jax

ERROR_LOG, ERROR_LOG_BYTES = 5, 6  # CUjit_option
LOG = 8192


class Loaded:
    """A kernel, kept as long as this object.

    Args:
      code: PTX that ends with a zero, or machine code.
      name: of the kernel in it.

    Attributes:
      address: the driver's handle, a CUkernel.
      launch: address of `cuLaunchKernel`.

    Raises:
      NotImplementedError: there is no driver, or it refuses the program.
    """

    def __init__(self, code: bytes, name: str = "lanes"):
        driver = _driver()
        self.launch = ctypes.cast(driver.cuLaunchKernel, ctypes.c_void_p).value or 0
        log, library, kernel = ctypes.create_string_buffer(LOG), _pointer(), _pointer()
        options = (ctypes.c_int * 2)(ERROR_LOG, ERROR_LOG_BYTES)
        values = (ctypes.c_void_p * 2)(ctypes.addressof(log), LOG)
        answer = driver.cuLibraryLoadData(
            ctypes.byref(library), code, options, values, 2, None, None, 0
        )
        _check("cuLibraryLoadData", answer, log.value.decode(errors="replace"))
        _check(
            "cuLibraryGetKernel",
            driver.cuLibraryGetKernel(ctypes.byref(kernel), library, name.encode()),
        )
        self._library, self.address = library, kernel.value or 0
        for device in jax.local_devices(backend="cuda"):
            self._prepare(device.local_hardware_id, kernel)

    def _prepare(self, number: int, kernel: Any) -> None:
        """Compile for a device now, for that may not happen while a command buffer is recorded."""
        driver, device, context, function = _driver(), ctypes.c_int(), _pointer(), _pointer()
        _check("cuDeviceGet", driver.cuDeviceGet(ctypes.byref(device), number))
        retained = driver.cuDevicePrimaryCtxRetain(ctypes.byref(context), device)
        _check("cuDevicePrimaryCtxRetain", retained)
        _check("cuCtxPushCurrent", driver.cuCtxPushCurrent_v2(context))
        found = driver.cuKernelGetFunction(ctypes.byref(function), kernel)
        driver.cuCtxPopCurrent_v2(ctypes.byref(context))
        _check("cuKernelGetFunction", found)


def capability() -> int:
    """Compute capability of the devices, 90 for 9.0.

    Raises:
      NotImplementedError: there is no device of CUDA.
    """
    try:
        return round(10 * float(jax.devices("cuda")[0].compute_capability))
    except RuntimeError:
        raise NotImplementedError("a GPU that is not here") from None


def _pointer() -> ctypes.c_void_p:
    return ctypes.c_void_p()


@functools.cache
def _driver() -> Any:
    try:
        library = ctypes.CDLL("libcuda.so.1")
    except OSError as error:
        raise NotImplementedError(f"CUDA's driver: {error}") from None
    if not hasattr(library, "cuLibraryLoadData"):
        raise NotImplementedError("a driver older than that of CUDA 12")
    _check("cuInit", library.cuInit(0))
    return library


def _check(name: str, code: int, log: str = "") -> None:
    if code:
        raise NotImplementedError(f"why CUDA's driver answers {code} to {name} {log}".rstrip())
