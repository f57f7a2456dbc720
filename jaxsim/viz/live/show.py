"""The loop of a live view: steps, pictures, wishes."""

import importlib
import time
import warnings
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from jaxsim.io import to_mujoco
from jaxsim.model import Model, State
from jaxsim.viz.live.browser import Browser, Wishes
from jaxsim.viz.live.clock import Clock
from jaxsim.viz.live.source import Free, Inputs, Parameters

FRAME = 1 / 30  # s


def in_browser(
    source: Free,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    title: str = "jaxsim",
    ready: Callable[[str], None] = lambda url: None,
    until: Callable[[], bool] = lambda: False,
) -> None:
    """Simulate and show in a page of the browser, until it is interrupted.

        jaxsim.viz.live.in_browser(jaxsim.viz.live.Free(model), ready=print)

    Args:
      source: what moves: `Free(model)`, or `Played(env, policy)`.
      host: address to listen on; "0.0.0.0" lets other machines in.
      port: to listen on; the next free one if it is taken.
      title: of the page.
      ready: is called with the address of the page.
      until: end when this returns true.

    Raises:
      RuntimeError: viser is not installed.
    """
    show = _Show(source)
    page = Browser(show.drawn, source.steered, host, port, title)
    try:
        ready(page.url)
        show.advance(page.wishes, 0.0)  # compiles
        before = time.perf_counter()
        while not until():
            now = time.perf_counter()
            show.advance(page.wishes, now - before)
            page.show(show.data, show.contacts(page.wishes), show.scale, show.text())
            before = now
            time.sleep(max(0.0, FRAME - (time.perf_counter() - now)))
    finally:
        page.close()


def in_window(source: Free) -> None:
    """Simulate and show in MuJoCo's own window: sliders, forces by the mouse, pause by space.

    Args:
      source: what moves: `Free(model)`, or `Played(env, policy)`.

    Raises:
      RuntimeError: there is no display.
    """
    import mujoco.viewer

    _check_display()
    show = _Show(source)
    pressed: list[int] = []
    wishes = Wishes(Parameters.of(show.drawn), np.zeros(show.drawn.nu))
    show.advance(wishes, 0.0)  # compiles
    window = mujoco.viewer.launch_passive(show.drawn, show.data, key_callback=pressed.append)
    before = time.perf_counter()
    with window:
        while window.is_running():
            now = time.perf_counter()
            wishes.paused ^= bool(pressed.count(ord(" ")) % 2)
            pressed.clear()
            with window.lock():
                wishes.ctrl = np.array(show.data.ctrl)
                show.advance(wishes, now - before, np.array(show.data.xfrc_applied))
            window.sync()
            before = now
            time.sleep(max(0.0, FRAME - (time.perf_counter() - now)))


def _check_display() -> None:
    """Say what is missing; MuJoCo would end the process."""
    glfw = importlib.import_module("glfw")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if glfw.init():
            return
    raise RuntimeError("MuJoCo's window needs a display, and there is none; the browser does not")


class _Show:
    """The state that is shown, and its data.

    Attributes:
      drawn: the model with its looks.
      data: poses of the state.
      scale: length of a contact force's arrow for each newton (m/N).
    """

    def __init__(self, source: Free):
        self._source, self._inputs = source, Inputs.of(source.model)
        self.drawn = to_mujoco(source.model)
        self._parameters: Parameters | None = None
        self.data = mujoco.MjData(self.drawn)
        self._state: Any = source.reset(0)
        self._clock, self._resets = Clock(source.dt, FRAME), 0
        weight = self.drawn.body_subtreemass[0] * max(np.abs(self.drawn.opt.gravity).max(), 1.0)
        self.scale = float(0.5 * self.drawn.stat.extent / max(weight, 1e-9))

    @property
    def state(self) -> State:
        """The physics."""
        return self._source.physics(self._state)

    def advance(self, wishes: Wishes, elapsed: float, forces: np.ndarray | None = None) -> None:
        """Take the steps that are due, as the user wishes."""
        if wishes.reset:
            self._resets, wishes.reset = self._resets + 1, False
            self._state = self._source.reset(self._resets)
        count = 0 if wishes.paused else self._clock.due(elapsed, wishes.speed)
        self._inputs = self._asked(wishes, forces).replace(model=self._changed(wishes.parameters))
        self._state = jax.block_until_ready(self._source.advance(self._state, self._inputs, count))
        self._pose()

    def contacts(self, wishes: Wishes) -> np.ndarray:
        """Points and forces (n, 6) of the contacts, if they are to be seen."""
        if not wishes.contacts:
            return np.zeros((0, 6))
        found = jax.device_get(self._source.contacts(self.state, self._inputs))
        force = np.einsum("cij,ci->cj", found.frame, found.force[..., :3])
        return np.concatenate([found.pos, force], axis=-1)[found.active]

    def text(self) -> str:
        """Simulated time, and how fast it goes."""
        return f"{float(self.state.time):.2f} s, {self._clock.pace:.2f} x real time"

    def _asked(self, wishes: Wishes, forces: np.ndarray | None) -> Inputs:
        model = self._source.model
        dtype = model.qpos0.dtype
        push = np.zeros((model.nbody, 6)) if forces is None else forces
        if wishes.pull is not None:
            push[wishes.pull.body] += wishes.pull.wrench(self.drawn, self.data)
        return self._inputs.replace(
            ctrl=jnp.asarray(wishes.ctrl, dtype),
            xfrc_applied=jnp.asarray(push, dtype),
        )

    def _changed(self, parameters: Parameters) -> Model:
        """The model that is simulated; another one where the user has changed its numbers."""
        if parameters == self._parameters:
            return self._inputs.model
        self._parameters = parameters
        dtype = self._source.model.qpos0.dtype
        numbers = {name: jnp.asarray(x, dtype) for name, x in vars(parameters).items()}
        return self._source.changed(Parameters(**numbers))

    def _pose(self) -> None:
        state, data = self.state, self.data
        data.qpos[:], data.qvel[:], data.time = state.qpos, state.qvel, float(state.time)
        data.mocap_pos[:], data.mocap_quat[:] = state.mocap_pos, state.mocap_quat
        mujoco.mj_kinematics(self.drawn, data)
        mujoco.mj_comPos(self.drawn, data)
        mujoco.mj_comVel(self.drawn, data)
