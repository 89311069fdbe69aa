"""Grains over a slice, drawn in the pixels of the screen so that outlines are equally wide at every zoom."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int, UInt8
from PySide6.QtCore import QRect, QRectF
from PySide6.QtGui import QImage, QPainter

from mbstudio.scene.label_overlay import LabelLook, label_overlay


class PaneLabels:
    """The labels of a slice, and the picture of them as it was drawn last."""

    def __init__(self) -> None:
        self._labels: Int[np.ndarray, "h w"] | None = None
        self._colours: UInt8[np.ndarray, "k 3"] | None = None
        self._look = LabelLook()
        self._drawn: tuple[object, ...] = ()
        self._picture: QImage | None = None
        self._place = QRect()

    def set(
        self,
        labels: Int[np.ndarray, "h w"] | None,
        colours: UInt8[np.ndarray, "k 3"] | None,
        look: LabelLook,
    ) -> None:
        """Take labels (their first row is drawn lowest), the colour of each, and how they are drawn."""
        self._labels, self._colours, self._look = labels, colours, look
        self._drawn = ()

    def paint(self, painter: QPainter, rect: QRectF, widget: QRect, ratio: float) -> None:
        """Draw what is to be seen of the labels.

        Parameters
        ----------
        painter : QPainter
        rect : QRectF
            Where the whole slice lies on the widget.
        widget : QRect
        ratio : float
            Pixels of the screen in one of the widget.
        """
        if self._labels is None or self._colours is None or self._look.draws_nothing:
            return
        wanted = (rect.getRect(), widget.getRect(), ratio)
        if wanted != self._drawn:
            self._draw(rect, widget, ratio)
            self._drawn = wanted
        if self._picture is not None:
            painter.drawImage(self._place, self._picture)

    def _draw(self, rect: QRectF, widget: QRect, ratio: float) -> None:
        labels, colours = self._labels, self._colours
        assert labels is not None
        assert colours is not None
        place = rect.toAlignedRect() & widget
        self._picture, self._place = None, place
        if place.isEmpty():
            return
        height, width = labels.shape
        wide, high = round(place.width() * ratio), round(place.height() * ratio)
        left = place.left() + (np.arange(wide) + 0.5) / ratio - rect.left()
        up = rect.bottom() - place.top() - (np.arange(high) + 0.5) / ratio
        columns = np.clip((left / rect.width() * width).astype(np.int64), 0, width - 1)
        rows = np.clip((up / rect.height() * height).astype(np.int64), 0, height - 1)
        seen = labels[rows][:, columns]
        if not seen.any():
            return
        picture = label_overlay(seen, colours, self._look, max(1, round(ratio)))
        self._picture = QImage(
            picture.tobytes(), wide, high, 4 * wide, QImage.Format.Format_RGBA8888
        ).convertToFormat(QImage.Format.Format_ARGB32_Premultiplied)
