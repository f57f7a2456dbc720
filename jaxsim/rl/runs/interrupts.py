"""Handling of interrupts so that epochs that run can finish."""

import contextlib
import signal
import threading
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts(contextlib.AbstractContextManager):
    """A context in which the first interrupt is only recorded; a second one raises as usual.

    Attributes:
      seen: whether there was an interrupt.
    """

    def __init__(self):
        self.seen = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "Interrupts":
        """Install the handlers, if this is the main thread."""
        if threading.current_thread() is threading.main_thread():
            self._before = {s: signal.signal(s, self._note) for s in _SIGNALS}
        return self

    def __exit__(self, *_) -> None:
        """Restore the previous handlers."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    def _note(self, *_) -> None:
        self.seen = True
        self.__exit__()
