"""The live grain's factors among the parents': a radar against their median, a table, a light."""

from __future__ import annotations

import math

import numpy as np
from jaxtyping import Float
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QGridLayout, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from mbstudio.core.metrics.factor_table import FACTORS, LATENT_MEANINGS
from mbstudio.core.units import conversion_factor, unit_label
from mbstudio.core.vae.shaping.live_grain import LiveGrain
from mbstudio.core.vae.shaping.meaning_factors import MEANINGS
from mbstudio.ui.language import tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.factor_words import factor_title
from mbstudio.ui.widgets.forms import badge, label, set_badge
from mbstudio.ui.widgets.numbers import readable_power_unit


def describe_rank(name: str, below: float) -> str:
    """Return where a factor stands among the parents, in words: flatter than 85 %."""
    less, more = LATENT_MEANINGS[name].less, LATENT_MEANINGS[name].more
    share, word = (below, more) if below >= 0.5 else (1.0 - below, less)
    if share > 0.9999:
        return tr("{smaller} than all parents", smaller=tr(word))
    return tr("{smaller} than {percent:.0f} %", smaller=tr(word), percent=100 * share)


def show_lights(
    light: QLabel, edge: QLabel, grain: LiveGrain | None, held: bool, beyond: bool = False
) -> None:
    """Show whether a grain is valid, and whether it was held within the parents' range or let beyond it."""
    edge.setVisible(held and grain is not None)
    set_badge(edge, tr("▲ At the edge of the parents"), "amber")
    if grain is None:
        set_badge(light, tr("No grain"), "quiet")
    elif grain.is_sound and beyond:
        set_badge(light, tr("● Far outside the parents"), "bad")
        light.setToolTip(tr("One piece without voids, but far from all parents: check its factors"))
    elif grain.is_sound:
        set_badge(light, tr("● Valid"), "good")
        light.setToolTip(tr("One piece without voids"))
    else:
        wrong = (
            tr("● {count} pieces", count=grain.pieces)
            if grain.pieces > 1
            else tr("● {count} voids", count=grain.voids)
        )
        set_badge(light, wrong, "bad")
        light.setToolTip(tr("Not valid: a DEM engine needs one piece without voids"))


class Radar(QWidget):
    """The share of the parents that has less of each factor, as a polygon; the median is a ring."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self._theme = theme
        self.shares: np.ndarray | None = None
        self.setMinimumSize(220, 210)
        self.setAccessibleName(tr("Factors among the parents"))
        self.setToolTip(tr("Outer ring: more than all parents. Middle ring: the parents' median."))
        theme.changed.connect(self.update)

    def set_shares(self, shares: Float[np.ndarray, "5"] | None) -> None:
        """Show a grain."""
        self.shares = shares
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        tokens = self._theme.tokens
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        middle = QPointF(self.width() / 2, self.height() / 2 + 6)
        corner_words = {name: tr(meaning.short) for name, meaning in LATENT_MEANINGS.items()}
        longest = max(painter.fontMetrics().horizontalAdvance(words) for words in corner_words.values())
        radius = min(self.width() - 2 * longest - 36, self.height() - 56) / 2
        turns = [2 * math.pi * place / len(MEANINGS) - math.pi / 2 for place in range(len(MEANINGS))]

        def corners(shares: list[float]) -> list[QPointF]:
            return [
                middle + QPointF(math.cos(turn), math.sin(turn)) * radius * (0.08 + 0.92 * share)
                for turn, share in zip(turns, shares, strict=True)
            ]

        painter.setPen(QPen(QColor(tokens.border), 1))
        for ring in (0.25, 0.75, 1.0):
            painter.drawPolygon(corners([ring] * 5))
        for corner in corners([1.0] * 5):
            painter.drawLine(middle, corner)
        painter.setPen(QPen(QColor(tokens.muted), 1.4, Qt.PenStyle.DashLine))
        painter.drawPolygon(corners([0.5] * 5))
        if self.shares is not None:
            fill = QColor(tokens.accent)
            fill.setAlpha(70)
            painter.setBrush(fill)
            painter.setPen(QPen(QColor(tokens.accent), 2))
            shape = corners([float(share) for share in self.shares])
            painter.drawPolygon(shape)
            painter.setBrush(QColor(tokens.accent))
            for corner in shape:
                painter.drawEllipse(corner, 2.6, 2.6)
        painter.setPen(QColor(tokens.muted))
        for name, turn in zip(MEANINGS, turns, strict=True):
            place = middle + QPointF(math.cos(turn) * (radius + 12), math.sin(turn) * (radius + 14))
            wide = painter.fontMetrics().horizontalAdvance(corner_words[name])
            left = place.x() - wide * (0.5 - 0.5 * round(math.cos(turn), 3))
            left = min(max(left, 0.0), self.width() - wide)
            painter.drawText(QPointF(left, place.y() + 5), corner_words[name])
        painter.end()


class FactorPage(QWidget):
    """Everything that is measured of the grain under the hand, live."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.light, self.edge = badge(), badge()
        self.radar = Radar(theme)
        self._cells = {name: (label("–", "text"), label("", "hint")) for name in MEANINGS}
        self._volume, self._area = label("–", "text"), label("–", "text")
        lights = QHBoxLayout()
        lights.addWidget(self.light)
        lights.addWidget(self.edge)
        lights.addStretch(1)
        grid = QGridLayout()
        grid.setHorizontalSpacing(12)
        grid.setVerticalSpacing(5)
        self._among = label(tr("Among the parents"), "hint")
        grid.addWidget(self._among, 0, 2)
        for line, (name, (value, words)) in enumerate(self._cells.items(), 1):
            heading = label(tr(LATENT_MEANINGS[name].title), "key")
            heading.setToolTip(tr(LATENT_MEANINGS[name].meaning))
            grid.addWidget(heading, line, 0)
            grid.addWidget(value, line, 1, Qt.AlignmentFlag.AlignRight)
            grid.addWidget(words, line, 2)
        for line, (title, value) in enumerate(
            ((factor_title("volume"), self._volume), (factor_title("area"), self._area)), 6
        ):
            grid.addWidget(label(title, "key"), line, 0)
            grid.addWidget(value, line, 1, 1, 2)
        grid.setColumnStretch(2, 1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(14, 12, 14, 12)
        layout.setSpacing(10)
        layout.addLayout(lights)
        layout.addWidget(self.radar, 1)
        layout.addLayout(grid)
        layout.addStretch(0)
        self.show_grain(None, None, False)

    def show_grain(
        self,
        grain: LiveGrain | None,
        shares: Float[np.ndarray, "5"] | None,
        held: bool,
        beyond: bool = False,
    ) -> None:
        """Show a grain's factors, their places among the parents', and whether it is valid."""
        self.radar.set_shares(shares)
        show_lights(self.light, self.edge, grain, held, beyond)
        if grain is None or shares is None:
            return
        unit = unit_label(grain.avatar.unit)
        for (name, value), share in zip(grain.values.items(), shares, strict=True):
            text, words = self._cells[name]
            text.setText(f"{value:.4g} {unit}" if name == "size" else f"{value:.3f}")
            words.setText(describe_rank(name, float(share)))
        for field, value, name in ((self._volume, grain.volume, "volume"), (self._area, grain.area, "area")):
            factor = FACTORS[name]
            told = readable_power_unit(value, grain.avatar.unit, factor.power)
            scaled = value * conversion_factor(grain.avatar.unit, told) ** factor.power
            field.setText(f"{scaled:.4g} {factor.unit(told)}")

    def value(self, name: str) -> str:
        """Return what is written for a factor."""
        return self._cells[name][0].text()

    def words(self, name: str) -> str:
        """Return where a factor stands among the parents, as written."""
        return self._cells[name][1].text()
