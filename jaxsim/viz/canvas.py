"""Pixels of a MuJoCo scene, drawn without a screen."""

import contextlib
import importlib
import os
import sys
import weakref

import mujoco
import numpy as np

_NO_OPENGL = (
    "MuJoCo cannot draw because it found no OpenGL: start Python with MUJOCO_GL=egl in the "
    "environment (on Debian and Ubuntu, `apt install libegl1 libgl1` installs EGL), or with "
    "MUJOCO_GL=osmesa where there is no graphics driver (`apt install libosmesa6`)"
)
_KINDS = {"egl": "mujoco.egl", "osmesa": "mujoco.osmesa", "glfw": "mujoco.glfw"}


class Canvas:
    """An OpenGL context of its own, into which scenes of one model are drawn."""

    def __init__(self, model: mujoco.MjModel, width: int, height: int):
        """Make the context.

        Args:
          model: its meshes and textures go to the context; its offscreen size is set.
          width: in pixels.
          height: in pixels.

        Raises:
          RuntimeError: there is no OpenGL to draw with.
        """
        looks = model.vis.global_
        looks.offwidth, looks.offheight = max(looks.offwidth, width), max(looks.offheight, height)
        self._size = (height, width)
        self._gl = _gl_context(width, height)
        self._gl.make_current()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_100)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN, self._context)
        # Also called at the end of the process, while OpenGL's modules are still there.
        self._free = weakref.finalize(self, _free, self._gl, self._context)

    def draw(self, scene: mujoco.MjvScene, label: str = "") -> np.ndarray:
        """The picture of a scene, shape (height, width, 3), bytes, with a label in a corner."""
        self._gl.make_current()
        height, width = self._size
        frame, whole = np.empty((height, width, 3), np.uint8), mujoco.MjrRect(0, 0, width, height)
        mujoco.mjr_render(whole, scene, self._context)
        if label:
            font, place = mujoco.mjtFont.mjFONT_NORMAL, mujoco.mjtGridPos.mjGRID_TOPLEFT
            mujoco.mjr_overlay(font, place, whole, label, "", self._context)
        mujoco.mjr_readPixels(frame, None, whole, self._context)
        return frame[::-1]  # OpenGL's first row is the lowest

    def close(self) -> None:
        """Free the context; nothing can be drawn after this."""
        self._free()


def _free(gl, context: mujoco.MjrContext) -> None:
    gl.make_current()
    context.free()
    gl.free()


def _gl_context(width: int, height: int):
    """MuJoCo's context by the user's choice, or else the first that works here.

    MuJoCo itself asks for a window where MUJOCO_GL says nothing, and fails where there is none.
    """
    if "MUJOCO_GL" in os.environ or sys.platform != "linux":
        with _explained():
            return mujoco.GLContext(width, height)
    screen = "DISPLAY" in os.environ or "WAYLAND_DISPLAY" in os.environ
    kinds = ["glfw", "egl"] if screen else ["egl", "osmesa"]
    for kind in kinds[:-1]:
        with contextlib.suppress(*_FAILURES):
            return _context_of(kind, width, height)
    with _explained():
        return _context_of(kinds[-1], width, height)


def _context_of(kind: str, width: int, height: int):
    return importlib.import_module(_KINDS[kind]).GLContext(width, height)


_FAILURES = (mujoco.FatalError, ImportError, AttributeError, RuntimeError)


@contextlib.contextmanager
def _explained():
    try:
        yield
    except _FAILURES as error:
        raise RuntimeError(_NO_OPENGL) from error
