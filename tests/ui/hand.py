"""What a hand does with the mouse, and what the eye sees of it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from PySide6.QtCore import QPoint, Qt
from PySide6.QtTest import QTest


def drag(slider, *shares):
    """Press a slider's handle, drag it to each share of its length, and let it go there."""
    button = Qt.MouseButton.LeftButton
    places = [QPoint(round(7 + share * (slider.width() - 14)), slider.height() // 2) for share in shares]
    QTest.mousePress(slider, button, pos=places[0])
    for start, end in pairwise(places):
        for step in (0.34, 0.67, 1.0):
            QTest.mouseMove(slider, start + (end - start) * step)
            QTest.qWait(5)
    QTest.mouseRelease(slider, button, pos=places[-1])


def changed(before, after):
    """Share of the pixels of two pictures that differ."""
    return float((np.abs(before.astype(int) - after).max(axis=2) > 12).mean())
