"""What XLA calls: a function of XLA's FFI, in LLVM's text; on a CPU it runs all groups of lanes.

The layout of the call frame is that of `c_api.h` in `jax.ffi.include_dir()`: a major and a minor
version are written there, and only the major one may change what stands where.
"""

import functools
import pathlib
import re

import jax

MAJOR = 0
# Bytes from the start of structures.
EXTENSION, ARGUMENTS, RESULTS = 8, 72, 112
EXTENSION_TYPE, METADATA, VERSION, TRAITS = 8, 24, 24, 32
BUFFER_DATA, BUFFER_RANK, BUFFER_DIMS = 24, 32, 40


@functools.cache
def version() -> tuple[int, int] | None:
    """The version of XLA's interface, or None where its header is not found or differs."""
    header = pathlib.Path(jax.ffi.include_dir()) / "xla/ffi/api/c_api.h"
    if not header.exists():
        return None
    text = header.read_text()
    found = [re.search(rf"XLA_FFI_API_{name} (\d+)", text) for name in ("MAJOR", "MINOR")]
    if None in found:
        return None
    major, minor = (int(match[1]) for match in found if match)
    return (major, minor) if major == MAJOR else None


def frame(inputs: int, outputs: int, memory: str = "", traits: int = 0) -> str:
    """Text that begins a function `@handler(ptr %f)` of a call frame.

    Asked for its metadata, the function answers with the version and its traits. Otherwise it goes
    on with a table `%p` of the addresses of all arguments and results, and the number `%n` of
    lanes, which is the last axis of the first result. `memory` are lines that reserve more memory.
    """
    minor = (version() or (0, 0))[1]
    addresses = []
    for k in range(inputs + outputs):
        source, i = ("%args", k) if k < inputs else ("%rets", k - inputs)
        addresses += [
            f"  %s{k} = getelementptr ptr, ptr {source}, i64 {i}",
            f"  %u{k} = load ptr, ptr %s{k}",
            f"  %d{k}p = getelementptr i8, ptr %u{k}, i64 {BUFFER_DATA}",
            f"  %d{k} = load ptr, ptr %d{k}p",
            f"  %t{k} = getelementptr ptr, ptr %p, i64 {k}",
            f"  store ptr %d{k}, ptr %t{k}",
        ]
    return "\n".join(
        [
            f"""define ptr @handler(ptr %f) {{
entry:
  %p = alloca [{inputs + outputs} x ptr], align 8
{memory}
  %ep = getelementptr i8, ptr %f, i64 {EXTENSION}
  %e = load ptr, ptr %ep
  %extended = icmp ne ptr %e, null
  br i1 %extended, label %ask, label %run
ask:
  %kp = getelementptr i8, ptr %e, i64 {EXTENSION_TYPE}
  %k = load i32, ptr %kp
  %is = icmp eq i32 %k, 1
  br i1 %is, label %tell, label %run
tell:
  %ip = getelementptr i8, ptr %e, i64 {METADATA}
  %i = load ptr, ptr %ip
  %major = getelementptr i8, ptr %i, i64 {VERSION}
  store i32 {MAJOR}, ptr %major
  %minor = getelementptr i8, ptr %i, i64 {VERSION + 4}
  store i32 {minor}, ptr %minor
  %traits = getelementptr i8, ptr %i, i64 {TRAITS}
  store i32 {traits}, ptr %traits
  ret ptr null
run:
  %ap = getelementptr i8, ptr %f, i64 {ARGUMENTS}
  %args = load ptr, ptr %ap
  %rp = getelementptr i8, ptr %f, i64 {RESULTS}
  %rets = load ptr, ptr %rp""",
            *addresses,
            f"""  %rankp = getelementptr i8, ptr %u{inputs}, i64 {BUFFER_RANK}
  %rank = load i64, ptr %rankp
  %dimsp = getelementptr i8, ptr %u{inputs}, i64 {BUFFER_DIMS}
  %dims = load ptr, ptr %dimsp
  %lastaxis = sub i64 %rank, 1
  %np = getelementptr i64, ptr %dims, i64 %lastaxis
  %n = load i64, ptr %np""",
        ]
    )


def handler(inputs: int, outputs: int, width: int, frame_bytes: int) -> str:
    """Text of `@handler`, for a program with `@group`, on a CPU.

    Args:
      inputs: number of arguments.
      outputs: number of results.
      width: lanes of a group; the last group ends with the last lane and may overlap another.
      frame_bytes: memory that a group needs.
    """
    return f"""{frame(inputs, outputs, f"  %m = alloca [{frame_bytes} x i8], align 64")}
  %final = sub i64 %n, {width}
  br label %loop
loop:
  %first = phi i64 [ 0, %run ], [ %next, %work ]
  %more = icmp slt i64 %first, %n
  br i1 %more, label %work, label %done
work:
  %over = icmp sgt i64 %first, %final
  %b = select i1 %over, i64 %final, i64 %first
  call void @group(ptr %m, ptr %p, i64 %b, i64 %n)
  %next = add i64 %first, {width}
  br label %loop
done:
  ret ptr null
}}"""
