"""One episode as a video, for `jaxsim train` and `jaxsim play`."""

import pathlib
from typing import Any

from jaxsim.cli.report import working
from jaxsim.rl.episode import film_episode


def save_video(env: Any, policy: Any, path: pathlib.Path, seed: int) -> str:
    """Play and draw one episode; returns what to tell the user."""
    try:
        with working("drawing an episode"):
            return f"video: {film_episode(env, policy, path, seed)}"
    except RuntimeError as error:
        return f"no video: {error}"
