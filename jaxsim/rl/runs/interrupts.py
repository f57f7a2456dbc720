"""Interrupts that let the present epoch finish."""

import contextlib
import signal
import threading
from typing import Any

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts(contextlib.AbstractContextManager):
    """While active, the first interrupt is only noted; the second one raises as usual.

    Attributes:
      seen: whether there was one.
    """

    def __init__(self):
        self.seen = False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> "Interrupts":
        """Start to listen; only the main thread can."""
        if threading.current_thread() is threading.main_thread():
            self._before = {s: signal.signal(s, self._note) for s in _SIGNALS}
        return self

    def __exit__(self, *_) -> None:
        """Restore what was done with signals before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before = {}

    def _note(self, *_) -> None:
        self.seen = True
        self.__exit__()
