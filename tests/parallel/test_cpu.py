"""What `configure_cpu` asks of JAX and XLA, each time in a process of its own."""

import os
import subprocess
import sys

import pytest

SCRIPT = """
import jax, jaxsim
from jaxsim.parallel import chunks
from jax._src.compiler import get_compile_options
before = chunks.lane_limits()
jaxsim.configure_cpu({cores})
options = get_compile_options(1, 1).SerializeAsString()
print(jax.local_device_count(), b"xla_cpu_disable_loop_unrolling" in options)
print(b"xla_cpu_fold_all_constants" in options, before is chunks.lane_limits())
{after}
"""


def run(cores="", after="", flags=None):
    environment = {k: v for k, v in os.environ.items() if k != "XLA_FLAGS"}
    environment |= {"JAX_PLATFORMS": "cpu"} | ({"XLA_FLAGS": flags} if flags else {})
    code = SCRIPT.format(cores=cores, after=after)
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )


@pytest.mark.parametrize(
    ("flags", "other"),
    [
        (None, False),
        ("--xla_cpu_multi_thread_eigen=false", False),
        ("--xla_backend_extra_options=xla_cpu_fold_all_constants", True),
    ],
)
def test_loops_are_kept_and_other_flags_too(flags, other):
    done = run(cores=3, flags=flags)
    assert done.stdout.split() == ["3", "True", str(other), "False"], done.stderr


def test_all_cores_by_default():
    done = run()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    assert done.stdout.split()[0] == str(cores), done.stderr


def test_asked_twice_the_option_stands_once():
    flags = "--xla_backend_extra_options=xla_cpu_disable_loop_unrolling"
    done = run(cores=1, flags=flags, after="import os; print(os.environ['XLA_FLAGS'])")
    assert done.stdout.split() == ["1", "True", "False", "True", flags], done.stderr


@pytest.mark.parametrize(
    ("call", "error"),
    [("jaxsim.configure_cpu(2)", "RuntimeError"), ("jaxsim.configure_cpu(0)", "ValueError")],
)
def test_refusals(call, error):
    done = run(cores=1, after=call)
    assert error in done.stderr
