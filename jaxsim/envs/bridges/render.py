"""Frames for Gymnasium's `render_mode="rgb_array"`."""

from jaxsim.envs.base.env import Env
from jaxsim.viz import Frames

MODES = ("rgb_array",)


def checked_mode(mode: str | None) -> str | None:
    """The mode itself, if it exists.

    Raises:
      ValueError: it does not.
    """
    if mode is not None and mode not in MODES:
        raise ValueError(f'render_mode must be None or "rgb_array", got {mode!r}')
    return mode


def frames(env: Env, width: int, height: int, camera: int | str | None) -> Frames:
    """The renderer of an environment's states, with the looks of its model's source."""
    return Frames(env.unwrapped.model, width, height, camera)
