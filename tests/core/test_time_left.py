"""The time left runs down like a clock, follows what happens, and never jumps."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mbstudio.core.time_left import TimeLeft


def told(course, step=0.1):
    """Return what is told at each tenth of a second of work whose share done is a function of time."""
    clock, found = TimeLeft(), []
    for number in range(1, 100_000):
        share = min(1.0, course(number * step))
        found.append((number * step, clock.look(number * step, share)))
        if share >= 1.0:
            return found
    raise AssertionError("it never ends")


def test_nothing_is_said_before_something_is_known():
    clock = TimeLeft()
    assert clock.look(0.2, 0.5) is None
    assert clock.look(5.0, 0.005) is None
    assert clock.look(6.0, 0.5) == pytest.approx(6.0)


def test_steady_work_is_told_exactly():
    for now, left in told(lambda t: t / 60):
        if left is not None:
            assert left == pytest.approx(60 - now, abs=0.2)


def test_work_that_becomes_slower_widens_without_a_jump():
    course = told(lambda t: t / 40 if t < 20 else 0.5 + (t - 20) / 160)
    left = np.array([value for _, value in course if value is not None])
    assert (np.diff(left) <= 0.03 * np.maximum(left[:-1], 1.0)).all(), "a quarter in a second at most"
    at = {round(now, 1): value for now, value in course}
    assert at[20.0] == pytest.approx(20, abs=2)
    assert at[45.0] == pytest.approx(55, rel=0.1)
    assert at[60.0] == pytest.approx(40, rel=0.05)
    assert course[-1][1] == 0.0


@given(st.lists(st.tuples(st.floats(0.01, 30.0), st.floats(0.0, 0.2)), min_size=2, max_size=60))
def test_it_is_never_negative_and_never_grows_by_more_than_a_quarter_a_second(steps):
    clock, elapsed, share, before = TimeLeft(), 0.0, 0.0, None
    for passed, gained in steps:
        elapsed, share = elapsed + passed, min(1.0, share + gained)
        left = clock.look(elapsed, share)
        if left is not None:
            assert np.isfinite(left)
            assert left >= 0
            if before is not None:
                assert left <= max(before, 1.0) * (1 + 0.25 * passed) + 1e-9
            before = left
