"""How many steps to take so that simulated time keeps pace with the wall's."""


class Clock:
    """Simulated time against wall time.

    Attributes:
      pace: simulated seconds per second that were reached, over the last frames.
    """

    def __init__(self, dt: float, frame: float, most: int = 1000):
        """Remember the time of a step and of a frame (s), and the most steps for a frame."""
        self._dt, self._frame, self._most = dt, frame, most
        self._debt, self.pace = 0.0, 1.0

    def due(self, elapsed: float, speed: float) -> int:
        """Steps that are due after so much wall time (s) at a speed; what is missed is dropped.

        Where steps take longer than the time they simulate, a frame gets no more of them than
        would fill two frames: the picture stays smooth, and time goes slower.
        """
        self._debt += min(elapsed, 2 * self._frame) * speed
        count = min(int(self._debt / self._dt), self._most)
        self._debt -= count * self._dt
        if elapsed > 0:
            self.pace += 0.1 * (count * self._dt / elapsed - self.pace)
        return count
