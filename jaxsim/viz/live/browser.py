"""A page in the browser, by viser: bodies, marks, and what the user can change."""

import dataclasses
import importlib
import math
from typing import Any

import mujoco
import numpy as np

from jaxsim.viz.drawing import drawing
from jaxsim.viz.live.pull import Pull
from jaxsim.viz.live.solids import solid
from jaxsim.viz.live.source import Parameters

_NO_VISER = "the page in the browser needs viser: pip install viser"
_SPEEDS, _MASSES = (0.1, 2.0), (0.1, 5.0)
_LONGEST = 1.5  # radii


@dataclasses.dataclass
class Wishes:
    """What the user has asked for; read by the loop, set by the page's threads.

    Attributes:
      paused: stand still.
      reset: start again at the next frame.
      speed: simulated seconds per second.
      contacts: show contact forces.
      com: show the centre of mass.
      parameters: of the model.
      ctrl: controls.
      pull: the body that the mouse holds.
    """

    parameters: Parameters
    ctrl: np.ndarray
    paused: bool = False
    reset: bool = False
    speed: float = 1.0
    contacts: bool = False
    com: bool = False
    pull: Pull | None = None


class Browser:
    """The page; bodies are placed by `show`.

    Attributes:
      wishes: what the user asks for.
      url: where the page is.
    """

    def __init__(self, model: mujoco.MjModel, steered: bool, host: str, port: int, title: str):
        """Start the server.

        Args:
          model: what is shown.
          steered: offer a slider for each actuator.
          host: address to listen on.
          port: to listen on; the next free one if it is taken.
          title: of the page.

        Raises:
          RuntimeError: viser is not installed.
        """
        try:
            viser = importlib.import_module("viser")
        except ImportError as error:
            raise RuntimeError(_NO_VISER) from error
        self._model, self._data = model, mujoco.MjData(model)
        mujoco.mj_forward(model, self._data)
        self._server = viser.ViserServer(host=host, port=port, label=title, verbose=False)
        self.url = f"http://{host}:{self._server.get_port()}"
        self.wishes = Wishes(Parameters.of(model), np.zeros(model.nu))
        self._drawing = drawing(model, self._data)
        self._mass = np.zeros(model.nbody)
        self._mass[self._drawing.moving] = model.body_mass[self._drawing.moving]
        self._bodies = self._add_bodies()
        self._marks: list[Any] = []
        self._add_panel(steered)

    def close(self) -> None:
        """Stop the server."""
        self._server.stop()

    def show(self, data: mujoco.MjData, contacts: np.ndarray, scale: float, text: str) -> None:
        """Place everything.

        Args:
          data: with poses.
          contacts: points and forces (n, 6), world axes (m, N).
          scale: length of an arrow for each newton (m/N).
          text: how it goes.
        """
        with self._server.atomic():
            for body, frame in self._bodies.items():
                frame.position, frame.wxyz = data.xpos[body], data.xquat[body]
            for mark in self._marks:
                mark.remove()
            self._marks = [*self._arrows(contacts, scale), *self._center_of_mass(data)]
        self._text.value = text

    def _add_bodies(self) -> dict[int, Any]:
        scene, drawn = self._server.scene, self._drawing
        scene.set_up_direction("+z")
        self._server.gui.configure_theme(show_share_button=False)
        self._server.initial_camera.position = drawn.center + drawn.extent * np.array(
            [1.5, -4, 1.2]
        )
        self._server.initial_camera.look_at = drawn.center
        frames = {
            int(body): scene.add_frame(f"/bodies/{body}", show_axes=False) for body in drawn.moving
        }
        for number, geom in enumerate(drawn.geoms):
            self._add_geom(number, geom)
        return frames

    def _add_geom(self, number: int, geom: dict[str, Any]) -> None:
        shape, fixed = solid(geom, self._drawing), geom["slot"] < 0
        body = 0 if fixed else int(self._drawing.moving[geom["slot"]])
        rgba = np.asarray(geom["rgba"])
        mesh = self._server.scene.add_mesh_simple(
            f"/world/{number}" if fixed else f"/bodies/{body}/{number}",
            np.asarray(shape.points, np.float32),
            np.asarray(shape.faces, np.uint32),
            color=tuple(int(c) for c in 255 * rgba[:3]),
            opacity=float(rgba[3]) if rgba[3] < 1 else None,
            flat_shading=geom["type"] in ("box", "plane", "cylinder", "surface"),
            side="double",
            wxyz=np.roll(geom["quat"], 1),
            position=geom["pos"],
        )
        if fixed:
            self._add_tiles(number, geom)
            return

        async def dragged(event) -> None:
            ends = np.array(event.start_position), np.array(event.end_position)
            self.wishes.pull = None if event.phase == "end" else Pull(body, *ends)

        mesh.on_drag(dragged)

    def _add_tiles(self, number: int, geom: dict[str, Any]) -> None:
        """Lines by which one sees that something moves over a plane."""
        if geom["type"] != "plane":
            return
        extent = self._drawing.extent
        tile = 10 ** round(math.log10(extent)) / 2
        wide = [2 * (size or 20 * extent) for size in geom["size"][:2]]
        self._server.scene.add_grid(
            f"/world/{number}-tiles",
            *wide,
            cell_size=tile,
            section_size=2 * tile,
            fade_distance=15 * extent,
            wxyz=np.roll(geom["quat"], 1),
            position=np.array(geom["pos"]) + np.array([0, 0, 2e-3 * extent]),
        )

    def _add_panel(self, steered: bool) -> None:
        gui, wishes = self._server.gui, self.wishes
        self._text = gui.add_text("time", initial_value="compiling", disabled=True)
        pause = gui.add_button("pause / go on")
        reset = gui.add_button("start again")

        @pause.on_click
        def _(_):
            wishes.paused = not wishes.paused

        @reset.on_click
        def _(_):
            wishes.reset = True

        self._follow(gui.add_slider("speed", *_SPEEDS, 0.1, 1.0), "speed")
        self._follow(gui.add_checkbox("contact forces", False), "contacts")
        self._follow(gui.add_checkbox("centre of mass", False), "com")
        self._add_parameters()
        if steered and self._model.nu:
            with gui.add_folder("controls"):
                for index in range(self._model.nu):
                    self._add_actuator(index)
        gui.add_markdown("Drag a body to pull it.")

    def _add_parameters(self) -> None:
        gui, gravity = self._server.gui, float(self.wishes.parameters.gravity)
        with gui.add_folder("physics"):
            self._set(gui.add_slider("gravity", min(-20.0, gravity), 5.0, 0.01, gravity), "gravity")
            self._set(gui.add_slider("friction x", 0.0, 3.0, 0.01, 1.0), "friction")
            self._set(gui.add_slider("damping x", 0.0, 10.0, 0.01, 1.0), "damping")
        with gui.add_folder("masses", expand_by_default=False):
            for body in np.nonzero(self._mass)[0].tolist():
                name = self._model.body(body).name or f"body {body}"
                self._set(gui.add_slider(f"{name} x", *_MASSES, 0.01, 1.0), "mass", body)

    def _set(self, slider: Any, name: str, body: int | None = None) -> None:
        """A parameter, or that of a body, that has the value of a slider."""

        @slider.on_update
        def _(_):
            now, value = self.wishes.parameters, slider.value
            if body is not None:
                value = (*now.mass[:body], value, *now.mass[body + 1 :])
            self.wishes.parameters = now.replace(**{name: value})

    def _add_actuator(self, index: int) -> None:
        limited = self._model.actuator_ctrllimited[index]
        low, high = self._model.actuator_ctrlrange[index].tolist() if limited else (-1.0, 1.0)
        actuator = int(np.searchsorted(self._model.actuator_ctrladr, index, side="right")) - 1
        name = self._model.actuator(actuator).name or f"actuator {actuator}"
        if self._model.actuator_ctrlnum[actuator] > 1:
            name = f"{name}, control {index}"
        middle = min(max(0.0, low), high)
        slider = self._server.gui.add_slider(name, low, high, (high - low) / 200, middle)

        @slider.on_update
        def _(_):
            self.wishes.ctrl[index] = slider.value

    def _follow(self, handle: Any, name: str) -> None:
        """A wish that has the value of a control of the page."""
        handle.on_update(lambda _: setattr(self.wishes, name, handle.value))

    def _arrows(self, contacts: np.ndarray, scale: float) -> list[Any]:
        if not len(contacts):
            return []
        arrows, extent = contacts[:, 3:] * scale, self._drawing.extent
        length = np.linalg.norm(arrows, axis=1, keepdims=True)
        arrows *= np.minimum(1, _LONGEST * extent / np.maximum(length, 1e-9))
        ends = np.stack([contacts[:, :3], contacts[:, :3] + arrows], axis=1)
        arrow = self._server.scene.add_arrows(
            "/contacts",
            ends,
            (31, 157, 85),
            shaft_radius=0.008 * extent,
            head_radius=0.02 * extent,
            head_length=0.05 * extent,
        )
        return [arrow]

    def _center_of_mass(self, data: mujoco.MjData) -> list[Any]:
        if not (self.wishes.com and self._mass.any()):
            return []
        middle = self._mass @ data.xipos / self._mass.sum()
        ball = self._server.scene.add_icosphere(
            "/com", 0.05 * self._drawing.extent, color=(208, 48, 48), position=middle
        )
        return [ball]
