"""A GPU that is described and not there: programs are traced and compiled for it, none is run."""

import contextlib
import pathlib
import time
from unittest import mock

DEVICE = pathlib.Path(__file__).parent / "h100.pbtxt"


@contextlib.contextmanager
def pretended():
    """JAX's default backend is the described one, and CUDA's driver takes every kernel."""
    import jax

    from jaxsim.lanes.gpu import driver

    with (
        mock.patch.object(jax, "default_backend", return_value="gpu"),
        mock.patch.object(driver, "capability", return_value=90),
        mock.patch.object(driver, "Loaded", _Taken),
    ):
        yield


class _Taken:
    """In the place of a kernel that the driver has loaded."""

    address = launch = 0

    def __init__(self, code: bytes):
        self.code = code


def device():
    """The described device."""
    from jax.experimental import topologies

    described = {"target_config": DEVICE.read_text(), "topology": "1x1x1"}
    try:
        return topologies.get_topology_desc("", "cuda", **described).devices[0]
    except NotImplementedError:
        raise SystemExit('XLA cannot compile for CUDA here: pip install "jax[cuda12]"') from None


def compile_for_device(f, *args, ours: bool = True):
    """The program of f for the device, with our options or XLA's, and the seconds it took."""
    import jax

    from jaxsim.parallel.devices import compiler_options

    there = jax.sharding.SingleDeviceSharding(device())
    kind = lambda x: jax.ShapeDtypeStruct(x.shape, x.dtype, sharding=there)  # noqa: E731
    start = time.perf_counter()
    options = compiler_options("gpu") if ours else None
    compiled = jax.jit(f).lower(*jax.tree.map(kind, args)).compile(options)
    return compiled, time.perf_counter() - start


def compile_training(name: str, task: str):
    """A trainer with its settings for a GPU, its epoch, its evaluation, and the epoch's seconds."""
    from jaxsim import envs
    from jaxsim.lanes.switch import enable_lanes
    from jaxsim.parallel.devices import device_mesh
    from jaxsim.rl import programs, resolve
    from jaxsim.rl.lookup import algorithm_class, make_env

    enable_lanes(True)
    settings, start = resolve(task, name), time.perf_counter()
    env = make_env(task, settings)
    algorithm = algorithm_class(name)(envs.AutoReset(env), settings, 1)
    mesh = device_mesh([device()])
    template = programs.Start(algorithm, 0, mesh).template
    epoch = programs.epoch_program(algorithm, mesh).lower(template).compile()
    seconds = time.perf_counter() - start
    evaluation = programs.evaluation_program(env, algorithm, 0, mesh)
    return algorithm, epoch, evaluation.lower(template.learner).compile(), seconds
