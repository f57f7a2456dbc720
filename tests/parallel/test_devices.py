"""How programs are compiled for the devices of a platform."""

from jaxsim.parallel.devices import compiler_options


def test_loops_of_a_gpu_are_in_command_buffers():
    """This compiler has the option: where one has not, all of `_gpu_options` is left out."""
    options = compiler_options("gpu")
    assert options is not None
    assert {"WHILE", "CONDITIONAL"} <= set(options["xla_gpu_enable_command_buffer"].split(","))


def test_other_platforms_have_their_own():
    assert compiler_options("tpu") is None
    assert set(compiler_options("cpu") or {}).isdisjoint(compiler_options("gpu") or {})
