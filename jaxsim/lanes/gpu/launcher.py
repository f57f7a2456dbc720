"""What XLA calls on the host to launch a kernel: a function of XLA's FFI in LLVM's text."""

from jaxsim.lanes.code import handler

# Lanes of a block: one warp, so that few lanes use as many processors as they can.
BLOCK = 32
# Bytes from the start of structures.
API, CONTEXT, CREATE_ERROR, GET_STREAM = 16, 24, 48, 80
# A launch is the same every time, and may be recorded in a command buffer.
RECORDABLE = 1
INTERNAL = 13
STREAM, ERROR = "{ i64, ptr, ptr, ptr }", "{ i64, ptr, ptr, i32 }"
MESSAGE = "jaxsim.lanes: cuLaunchKernel failed"
LAUNCH = (
    f"ptr %kernel, i32 %blocks, i32 1, i32 1, i32 {BLOCK}, i32 1, i32 1, i32 0, "
    "ptr %s, ptr %q, ptr null"
)


def launcher(inputs: int, outputs: int, kernel: int, launch: int) -> str:
    """Text of `@handler`, which launches a kernel with a thread for each lane.

    Args:
      inputs: number of arguments.
      outputs: number of results.
      kernel: the driver's handle of a kernel of all addresses and the number of lanes.
      launch: address of `cuLaunchKernel`.
    """
    count = inputs + outputs
    values = [*(f"%t{k}" for k in range(count)), "%lanes"]
    parameters = "\n".join(
        f"  %q{k} = getelementptr ptr, ptr %q, i64 {k}\n  store ptr {value}, ptr %q{k}"
        for k, value in enumerate(values)
    )
    memory = f"""  %lanes = alloca i64, align 8
  %q = alloca [{count + 1} x ptr], align 8
  %stream = alloca {STREAM}, align 8
  %error = alloca {ERROR}, align 8"""
    return f"""@message = internal constant [{len(MESSAGE) + 1} x i8] c"{MESSAGE}\\00"
{handler.frame(inputs, outputs, memory, RECORDABLE)}
  store i64 %n, ptr %lanes
{parameters}
  %apip = getelementptr i8, ptr %f, i64 {API}
  %api = load ptr, ptr %apip
  %contextp = getelementptr i8, ptr %f, i64 {CONTEXT}
  %context = load ptr, ptr %contextp
  store {STREAM} {{ i64 32, ptr null, ptr null, ptr null }}, ptr %stream
  %asked = getelementptr {STREAM}, ptr %stream, i32 0, i32 2
  store ptr %context, ptr %asked
  %getp = getelementptr i8, ptr %api, i64 {GET_STREAM}
  %get = load ptr, ptr %getp
  %unknown = call ptr %get(ptr %stream)
  %known = icmp eq ptr %unknown, null
  br i1 %known, label %found, label %lost
lost:
  ret ptr %unknown
found:
  %answer = getelementptr {STREAM}, ptr %stream, i32 0, i32 3
  %s = load ptr, ptr %answer
  %above = add i64 %n, {BLOCK - 1}
  %whole = udiv i64 %above, {BLOCK}
  %blocks = trunc i64 %whole to i32
  %none = icmp eq i32 %blocks, 0
  br i1 %none, label %done, label %go
go:
  %kernel = inttoptr i64 {kernel} to ptr
  %launch = inttoptr i64 {launch} to ptr
  %code = call i32 %launch({LAUNCH})
  %failed = icmp ne i32 %code, 0
  br i1 %failed, label %wrong, label %done
wrong:
  store {ERROR} {{ i64 28, ptr null, ptr @message, i32 {INTERNAL} }}, ptr %error
  %createp = getelementptr i8, ptr %api, i64 {CREATE_ERROR}
  %create = load ptr, ptr %createp
  %made = call ptr %create(ptr %error)
  ret ptr %made
done:
  ret ptr null
}}"""
