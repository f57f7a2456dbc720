"""One episode as a video, for `jaxsim train` and `jaxsim play`."""

import pathlib
from typing import Any

from jaxsim.rl.episode import film_episode


def save_video(env: Any, policy: Any, path: pathlib.Path, seed: int) -> str:
    """Play and draw one episode; returns what to tell the user."""
    try:
        return f"video: {film_episode(env, policy, path, seed)}"
    except RuntimeError as error:
        return f"no video: {error}"
