"""The call frame of a launch, by a frame and a driver of our own in the place of XLA's."""

import ctypes

import pytest

pytest.importorskip("llvmlite")

from jaxsim.lanes.code.machine import Loaded, object_code
from jaxsim.lanes.gpu.launcher import BLOCK, launcher

POINTER, INT, SIZE = ctypes.c_void_p, ctypes.c_int, ctypes.c_size_t
LAUNCH = ctypes.CFUNCTYPE(INT, POINTER, *[ctypes.c_uint] * 7, POINTER, POINTER, POINTER)
ASKED = ctypes.CFUNCTYPE(POINTER, POINTER)


class Buffer(ctypes.Structure):
    _fields_ = [
        ("size", SIZE),
        ("extension", POINTER),
        ("dtype", INT),
        ("data", POINTER),
        ("rank", ctypes.c_int64),
        ("dims", ctypes.POINTER(ctypes.c_int64)),
    ]


class Values(ctypes.Structure):
    _fields_ = [
        ("struct_size", SIZE),
        ("extension", POINTER),
        ("size", ctypes.c_int64),
        ("types", POINTER),
        ("values", ctypes.POINTER(POINTER)),
    ]


class Api(ctypes.Structure):
    _fields_ = [
        ("head", SIZE * 6),
        ("create_error", ASKED),
        ("other", SIZE * 3),
        ("get_stream", ASKED),
    ]


class Frame(ctypes.Structure):
    _fields_ = [
        ("size", SIZE),
        ("extension", POINTER),
        ("api", ctypes.POINTER(Api)),
        ("context", POINTER),
        ("stage", INT),
        ("args", Values),
        ("rets", Values),
    ]


class Stream(ctypes.Structure):
    _fields_ = [("size", SIZE), ("extension", POINTER), ("context", POINTER), ("stream", POINTER)]


class Error(ctypes.Structure):
    _fields_ = [
        ("size", SIZE),
        ("extension", POINTER),
        ("message", ctypes.c_char_p),
        ("code", INT),
    ]


class Metadata(ctypes.Structure):
    _fields_ = [
        ("size", SIZE),
        ("version", SIZE * 2),
        ("major", INT),
        ("minor", INT),
        ("traits", ctypes.c_uint32),
    ]


class Extension(ctypes.Structure):
    _fields_ = [
        ("size", SIZE),
        ("type", INT),
        ("next", POINTER),
        ("metadata", ctypes.POINTER(Metadata)),
    ]


def values(buffers):
    pointers = (POINTER * len(buffers))(*[ctypes.addressof(b) for b in buffers])
    return Values(ctypes.sizeof(Values), None, len(buffers), None, pointers)


def buffer(address, *shape):
    return Buffer(48, None, 11, address, len(shape), (ctypes.c_int64 * len(shape))(*shape))


class Driver:
    """Remembers the launch, and answers as told."""

    def __init__(self, answer=0):
        self.answer, self.launched, self.error = answer, None, None
        self.launch = LAUNCH(self._launch)
        self.api = Api(create_error=ASKED(self._create), get_stream=ASKED(self._stream))

    def _launch(self, kernel, *numbers):
        grid, block, (memory, stream, parameters, extra) = numbers[:3], numbers[3:6], numbers[6:]
        listed = ctypes.cast(parameters, ctypes.POINTER(POINTER))
        addresses = [ctypes.cast(listed[k], ctypes.POINTER(POINTER))[0] for k in range(3)]
        lanes = ctypes.cast(listed[3], ctypes.POINTER(ctypes.c_int64))[0]
        self.launched = kernel, grid, block, memory, stream, addresses, lanes, extra
        return self.answer

    def _stream(self, asked):
        asked = ctypes.cast(asked, ctypes.POINTER(Stream))[0]
        assert asked.size == ctypes.sizeof(Stream)
        asked.stream = asked.context + 1
        return None

    def _create(self, error):
        error = ctypes.cast(error, ctypes.POINTER(Error))[0]
        self.error = error.message.decode(), error.code
        return 77


def called(driver, lanes, extension=None):
    text = launcher(2, 1, 4321, ctypes.cast(driver.launch, POINTER).value)
    loaded = Loaded(object_code(text))
    function = ctypes.CFUNCTYPE(POINTER, POINTER)(loaded.address("handler"))
    given, made = [buffer(111, 3, lanes), buffer(222, lanes)], [buffer(333, 5, lanes)]
    frame = Frame(
        ctypes.sizeof(Frame),
        extension and ctypes.addressof(extension),
        ctypes.pointer(driver.api),
        900,
        3,
        values(given),
        values(made),
    )
    return function(ctypes.addressof(frame))


def test_launch():
    driver = Driver()
    assert called(driver, 2 * BLOCK + 1) is None
    grid, block = (3, 1, 1), (BLOCK, 1, 1)
    assert driver.launched == (4321, grid, block, 0, 901, [111, 222, 333], 2 * BLOCK + 1, None)


def test_no_lanes():
    driver = Driver()
    assert called(driver, 0) is None
    assert driver.launched is None


def test_failure():
    driver = Driver(answer=700)
    assert called(driver, 1) == 77
    assert driver.error == ("jaxsim.lanes: cuLaunchKernel failed", 13)


def test_may_be_recorded():
    """XLA asks for the metadata first; launches may be part of a command buffer."""
    metadata, driver = Metadata(), Driver()
    assert called(driver, 1, Extension(32, 1, None, ctypes.pointer(metadata))) is None
    assert driver.launched is None
    assert (metadata.major, metadata.traits) == (0, 1)
