"""A step's results, read on the host from the words of a state."""

from collections.abc import Callable
from typing import Any

import numpy as np

from jaxsim.envs.bridges.spaces import public_info
from jaxsim.envs.bridges.words import Place, Words

_VIEWS = {"f": np.float32, "b": np.int32, "i": np.int32, "u": np.uint32}  # of numbers of 4 bytes


class Results:
    """Where observation, reward, both ends and the public infos lie in the words of a state."""

    def __init__(self, layout: Words):
        """Find the places, once."""
        state: Any = layout.places
        self._obs = state.obs
        self._told = [_reader(place) for place in (state.reward, state.terminated, state.truncated)]
        self._info = {name: _reader(place) for name, place in public_info(state).items()}

    def read(self, words: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """The results as NumPy arrays and Python numbers; nothing of them is a view."""
        views = {kind: words.view(dtype) for kind, dtype in _VIEWS.items()}
        reward, terminated, truncated = (read(words, views) for read in self._told)
        info = {name: read(words, views) for name, read in self._info.items()}
        return self._obs.read(words), reward, terminated, truncated, info


def _reader(place: Place) -> Callable[[np.ndarray, dict[str, np.ndarray]], Any]:
    """The function that reads one array, or one number as Python's."""
    kind, start = np.dtype(place.dtype).kind, place.start
    if place.shape:
        return lambda words, views: place.read(words)
    if place.count > 1 or kind not in _VIEWS:
        return lambda words, views: place.read(words).item()
    if kind == "b":
        return lambda words, views: bool(views[kind].item(start))
    return lambda words, views: views[kind].item(start)
