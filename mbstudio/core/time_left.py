"""How long work will still take, told so that the figure neither jumps nor promises too much."""

from __future__ import annotations

import math

_FIRST = 0.5  # seconds before which nothing is said
_LEAST = 0.01  # share before which nothing is said
_RECENT = 15.0  # seconds over which the speed is looked at
_CALM = 4.0  # seconds in which a new finding is taken over by two thirds
_WIDER = 0.25  # share by which the figure may grow in a second


class TimeLeft:
    """The time that work will still take.

    Two figures are made at each look: by the mean speed since the beginning and by the speed of late. The
    longer counts, as work that has become slower will hardly be faster than it has been of late. What is told
    runs down as a clock does and moves towards that figure in a few seconds; it never grows faster than by a
    quarter in a second.
    """

    def __init__(self) -> None:
        self._looks: list[tuple[float, float]] = [(0.0, 0.0)]
        self._told: float | None = None

    def look(self, elapsed: float, fraction: float) -> float | None:
        """Return the seconds left.

        Parameters
        ----------
        elapsed : float
            Seconds that the work has taken so far, without pauses.
        fraction : float
            Share that is done, 0 to 1.

        Returns
        -------
        float or None
            None before anything can be said.
        """
        before, _ = self._looks[-1]
        passed = max(0.0, elapsed - before)
        self._looks.append((elapsed, fraction))
        while len(self._looks) > 2 and self._looks[1][0] < elapsed - _RECENT:
            self._looks.pop(0)
        if fraction <= _LEAST or elapsed <= _FIRST:
            return None
        found = self._found(elapsed, fraction)
        if self._told is None:
            self._told = found
        else:
            expected = max(0.0, self._told - passed)
            moved = expected + (found - expected) * (1 - math.exp(-passed / _CALM))
            most = max(self._told, 1.0) * (1 + _WIDER * passed)
            self._told = min(moved, most)
        if fraction >= 1.0:
            self._told = 0.0
        return self._told

    def _found(self, elapsed: float, fraction: float) -> float:
        """Return the time left by the slower of the mean speed and that of late."""
        by_mean = elapsed * (1 - fraction) / fraction
        start, done = self._looks[0]
        span, gained = elapsed - start, fraction - done
        if start == 0.0 or span < _RECENT / 3 or gained <= 0:
            return by_mean
        return max(by_mean, span * (1 - fraction) / gained)
