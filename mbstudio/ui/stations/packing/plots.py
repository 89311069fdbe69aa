"""Plots of a packing: porosity by height and distance, coordination, rose of normals, comparison."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import QFrame, QLabel, QScrollArea, QStackedWidget, QTabBar, QVBoxLayout, QWidget

from mbstudio.core.packing.comparing import Difference, PackingComparison
from mbstudio.core.packing.trial import Findings
from mbstudio.core.units import unit_label
from mbstudio.ui.language import mark, tr
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.comparison_table import ComparisonTable
from mbstudio.ui.widgets.forms import label
from mbstudio.ui.widgets.numbers import four_digits
from mbstudio.ui.widgets.plots import Plot

NARROWEST = 260
PAGES = (
    ("numbers", mark("Numbers")),
    ("height", mark("Height")),
    ("walls", mark("Walls")),
    ("neighbours", mark("Neighbours")),
    ("rose", mark("Rose")),
)
KIND_NAMES = {"parents": mark("avatars"), "clones": mark("clones"), "spheres": mark("spheres")}
NUMBER_ROWS = (
    (mark("Porosity"), mark("Share of void in the inner part, counted on the avatars")),
    (mark("Void ratio"), mark("Volume of void over volume of solid")),
    (mark("Coordination"), mark("Mean number of other grains that a grain of the inner part touches")),
    (mark("Anisotropy"), mark("Of the contact normals: 0 for all directions alike")),
    (mark("Largest overlap"), mark("Of two clumps, or of a clump and the mould, in % of the mean diameter")),
    (mark("Height"), mark("Of the settled grains")),
    (mark("Width"), mark("Of the mould")),
    (mark("Grains inside"), mark("Grains of the inner part, by which coordination is measured")),
)
_DIGITS = {"porosity": 4, "coordination": 2, "anisotropy": 2}
_MEASURES = {
    "porosity": mark("Porosity"), "coordination": mark("Coordination"), "anisotropy": mark("Anisotropy"),
}  # fmt: skip


def kind_name(name: str) -> str:
    """Return what a kind of grains is called in the window."""
    return tr(KIND_NAMES[name]) if name in KIND_NAMES else name


class LinePlot(Plot):
    """A line of porosity over a length, with the mean of the inner part."""

    def __init__(self, theme: Theme, name: str, upright: bool) -> None:
        super().__init__(theme, "", "", name)
        self._upright = upright  # heights grow upwards, as in the mould
        self.setMouseEnabled(x=False, y=False)
        for side in ("bottom", "left"):
            self.getAxis(side).enableAutoSIPrefix(False)
        self._line = self.plot([], [])
        self._mean = pg.InfiniteLine(angle=90 if upright else 0)
        self.addItem(self._mean)
        self.repaint_theme()

    def repaint_theme(self) -> None:
        super().repaint_theme()
        tokens = self._theme.tokens
        self._line.setPen(pg.mkPen(tokens.accent, width=2))
        self._mean.setPen(pg.mkPen(tokens.warning, width=1.5, style=Qt.PenStyle.DashLine))

    def show_line(self, lengths: np.ndarray, shares: np.ndarray, mean: float, title: str) -> None:
        """Draw porosity over lengths."""
        good = np.isfinite(shares)
        lengths, shares = lengths[good], shares[good]
        x, y = (shares, lengths) if self._upright else (lengths, shares)
        self._line.setData(x, y)
        self._mean.setPos(mean)
        self.set_names(*((tr("Porosity"), title) if self._upright else (title, tr("Porosity"))))
        reach = float(lengths.max()) if len(lengths) else 1.0
        (self.setYRange if self._upright else self.setXRange)(0, reach, padding=0.02)
        (self.setXRange if self._upright else self.setYRange)(0, 1, padding=0.02)


class CountPlot(Plot):
    """How many grains touch so many others."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, tr("Grains touched"), tr("Grains"), tr("Histogram of the coordination"))
        self.setMouseEnabled(x=False, y=False)
        for side in ("bottom", "left"):
            self.getAxis(side).enableAutoSIPrefix(False)
        self._bars = pg.BarGraphItem(x=[], height=[], width=0.8)
        self.addItem(self._bars)
        self._mean = pg.InfiniteLine(angle=90)
        self.addItem(self._mean)
        self.repaint_theme()

    def repaint_theme(self) -> None:
        super().repaint_theme()
        tokens = self._theme.tokens
        self._bars.setOpts(brush=pg.mkBrush(tokens.accent), pen=pg.mkPen(None))
        self._mean.setPen(pg.mkPen(tokens.warning, width=1.5, style=Qt.PenStyle.DashLine))

    def show_counts(self, neighbours: np.ndarray) -> None:
        """Draw how often each number of neighbours occurs."""
        counts = np.bincount(neighbours)
        self._bars.setOpts(x=np.arange(len(counts)), height=counts)
        self._mean.setPos(float(neighbours.mean()))
        self.setXRange(-0.6, len(counts) - 0.4, padding=0)
        self.setYRange(0, max(float(counts.max()), 1.0) * 1.08, padding=0)


class RosePlot(Plot):
    """Directions of contact normals about the horizontal; a circle stands for all directions alike."""

    def __init__(self, theme: Theme) -> None:
        super().__init__(theme, "", "", tr("Rose of the contact normals"))
        self.setMouseEnabled(x=False, y=False)
        self.setAspectLocked(True)
        self.hideAxis("left")
        self.hideAxis("bottom")
        self._petals = self.plot([], [])
        self._circle = self.plot([], [])
        self._words = [pg.TextItem(anchor=anchor) for anchor in ((1, 1), (0.5, 1))]
        for words, text in zip(self._words, (tr("level"), tr("upright")), strict=True):
            words.setText(text)
            self.addItem(words, ignoreBounds=True)
        self.repaint_theme()

    def repaint_theme(self) -> None:
        super().repaint_theme()
        self.showGrid(x=False, y=False)
        tokens = self._theme.tokens
        self._petals.setPen(pg.mkPen(tokens.accent, width=1.5))
        fill = QColor(tokens.accent)
        fill.setAlpha(70)
        self._petals.setFillLevel("enclosed")
        self._petals.setBrush(pg.mkBrush(fill))
        self._circle.setPen(pg.mkPen(tokens.warning, width=1.5, style=Qt.PenStyle.DashLine))
        for words in self._words:
            words.setColor(QColor(tokens.muted))

    def show_rose(self, rose: np.ndarray) -> None:
        """Draw shares over chance by angle from 0 (level) to 90 degrees (upright), on all four sides."""
        edges = np.linspace(0, np.pi / 2, len(rose) + 1)
        angles = np.repeat(edges, 2)[1:-1]
        radii = np.repeat(rose, 2)
        whole = np.concatenate([angles, np.pi - angles[::-1], np.pi + angles, 2 * np.pi - angles[::-1]])
        lengths = np.concatenate([radii, radii[::-1], radii, radii[::-1]])
        whole, lengths = np.append(whole, whole[0]), np.append(lengths, lengths[0])
        self._petals.setData(lengths * np.cos(whole), lengths * np.sin(whole))
        turn = np.linspace(0, 2 * np.pi, 181)
        self._circle.setData(np.cos(turn), np.sin(turn))
        reach = 1.15 * max(1.0, float(rose.max(initial=0.0)))
        self.setXRange(-reach, reach, padding=0.06)
        self.setYRange(-reach, reach, padding=0.06)
        self._words[0].setPos(reach, 0)
        self._words[1].setPos(0, reach)


class NumbersPage(QScrollArea):
    """The numbers of the packing that is shown; of several, means and errors, and whether they differ."""

    def __init__(self) -> None:
        super().__init__()
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        content = QWidget()
        content.setObjectName("panelBody")
        self.table = ComparisonTable(tr("Measures of the packing"), NUMBER_ROWS)
        self.reason = label("", "hint", wrap=True)
        self.means = ComparisonTable(tr("Packings compared"), ())
        self.verdict = label("", "subtitle", wrap=True)
        self._note = label("", "hint", wrap=True)
        self._body = QVBoxLayout(content)
        self._body.setContentsMargins(14, 10, 14, 10)
        self._body.setSpacing(8)
        for part in (
            self.table, self.reason, label(tr("Compared"), "heading"), self.means, self.verdict, self._note,
        ):  # fmt: skip
            self._body.addWidget(part)
        self._body.addStretch(1)
        self.setWidget(content)

    def show_numbers(self, found: Findings | None, reason: str) -> None:
        """Show the numbers of a packing, or why there are none."""
        self.table.setVisible(found is not None)
        self.reason.setVisible(found is None)
        self.reason.setText(reason)
        if found is None:
            return
        told = found.summary
        unit = unit_label(str(told["unit"]))
        values = [
            f"{told['porosity']:.4f}", f"{told['void_ratio']:.4f}", f"{told['coordination']:.2f}",
            f"{told['anisotropy']:.2f}", f"{100 * told['overlap']:.3f}", four_digits(told["height"]),
            four_digits(told["width"]), f"{told['grains_inside']} / {told['grains']}",
        ]  # fmt: skip
        self.table.fill([tr("this packing")], [values], ["", "", "", "", "%", unit, unit, ""])

    def show_comparison(self, found: PackingComparison | None) -> None:
        """Show what several packings say, or how to have several."""
        self.means.setVisible(found is not None)
        self._note.setVisible(found is not None)
        if found is None:
            self.verdict.setText(
                tr(
                    "A single packing tells nothing of chance. Choose “All of them, compared”, or more "
                    "packings, on the left, and pack again."
                )
            )
            return
        rows, values = [], []
        for measure, digits in _DIGITS.items():
            rows.append((tr(_MEASURES[measure]), ""))
            values.append("")
            for kind, of_kind in found.means.items():
                mean = of_kind[measure]
                rows.append((f"    {kind_name(kind)}", ""))
                values.append(f"{mean.value:.{digits}f} ± {mean.error:.{digits}f}")
        table = ComparisonTable(tr("Packings compared"), rows)
        table.fill([tr("mean ± error")], [values], [""] * len(rows))
        self._body.replaceWidget(self.means, table)
        self.means.deleteLater()
        self.means = table
        self.verdict.setText("\n\n".join(verdict_words(one) for one in found.differences))
        self.verdict.setVisible(bool(found.differences))
        seeds = len(next(iter(next(iter(found.means.values())).values())).values)
        self._note.setText(
            tr(
                "Mean and standard error of {seeds} packings of each kind. “Differ”: chance alone makes so "
                "large a difference less than once in twenty (Welch's test).",
                seeds=seeds,
            )
        )


def verdict_words(one: Difference) -> str:
    """Return in words whether two kinds differ in a measure."""
    digits = _DIGITS[one.measure]
    measure, first, second = tr(_MEASURES[one.measure]), kind_name(one.first), kind_name(one.second)
    value, error = f"{one.value:+.{digits}f}".replace("-", "−"), f"{one.error:.{digits}f}"
    chance = f"{one.chance:.2g}" if one.chance >= 0.001 else "< 0.001"
    if one.differs:
        return tr(
            "{measure}: {second} and {first} differ, {value} ± {error} (p {chance}).",
            measure=measure, second=second, first=first, value=value, error=error, chance=chance,
        )  # fmt: skip
    return tr(
        "{measure}: no difference between {second} and {first} is seen, {value} ± {error} (p {chance}).",
        measure=measure, second=second, first=first, value=value, error=error, chance=chance,
    )  # fmt: skip


class PackingDock(QFrame):
    """Pages of plots, one at a time, or words where there is nothing to draw."""

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("plots")
        self.setMinimumWidth(NARROWEST)
        self.tabs = QTabBar()
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.setAccessibleName(tr("Kind of plot"))
        self.height_plot = LinePlot(theme, tr("Porosity by height"), upright=True)
        self.wall_plot = LinePlot(theme, tr("Porosity by the distance from the walls"), upright=False)
        self.count_plot = CountPlot(theme)
        self.rose_plot = RosePlot(theme)
        self.numbers = NumbersPage()
        self._pages: dict[str, QWidget] = dict(
            zip(
                (name for name, _ in PAGES),
                (self.numbers, self.height_plot, self.wall_plot, self.count_plot, self.rose_plot),
                strict=True,
            )
        )
        self._stack = QStackedWidget()
        for name, title in PAGES:
            self.tabs.addTab(tr(title))
            self._stack.addWidget(self._pages[name])
        self.words = QLabel()
        self.words.setObjectName("emptyPlot")
        self.words.setWordWrap(True)
        self.words.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.words.setContentsMargins(30, 0, 30, 0)
        self._stack.addWidget(self.words)
        self.note = label("", "hint", wrap=True)
        self.note.setContentsMargins(14, 4, 14, 8)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.tabs)
        layout.addWidget(self._stack, 1)
        layout.addWidget(self.note)
        self._findings: Findings | None = None
        self._has_trial = False
        self.tabs.currentChanged.connect(self._turn)
        self.say("")

    @property
    def page_name(self) -> str:
        """Name of the page that is looked at."""
        return PAGES[self.tabs.currentIndex()][0]

    def open_page(self, name: str) -> None:
        """Turn to a page."""
        self.tabs.setCurrentIndex([one for one, _ in PAGES].index(name))

    def say(self, words: str) -> None:
        """Say why there is nothing to draw."""
        self.words.setText(words)
        self._findings, self._has_trial = None, False
        self._turn()

    def show_packing(self, found: Findings | None, reason: str, comparison: PackingComparison | None) -> None:
        """Draw what was found of a packing; the reason where nothing could be."""
        self._findings, self._has_trial = found, True
        self.words.setText(reason)
        self.numbers.show_numbers(found, reason)
        self.numbers.show_comparison(comparison)
        if found is not None:
            unit, mean = unit_label(str(found.summary["unit"])), found.measures.porosity
            self.height_plot.show_line(found.heights, found.by_height, mean, tr("Height ({unit})", unit=unit))
            self.wall_plot.show_line(
                found.distances, found.by_distance, mean, tr("Distance from the walls ({unit})", unit=unit)
            )
            self.count_plot.show_counts(found.measures.neighbours)
            self.rose_plot.show_rose(found.rose)
        self._turn()

    def _turn(self, *_: object) -> None:
        page = self.page_name
        drawn = self._has_trial and (self._findings is not None or page == "numbers")
        self._stack.setCurrentWidget(self._pages[page] if drawn else self.words)
        notes = {
            "height": tr("Away from the side walls; dashed: the mean of the inner part."),
            "walls": tr("Between floor and surface; dashed: the mean of the inner part."),
            "neighbours": tr("Grains of the inner part; dashed: their mean."),
            "rose": tr("Angle of contact normals over chance; dashed: all directions alike."),
            "numbers": "",
        }
        self.note.setText(notes[page] if drawn else "")
        self.note.setVisible(bool(self.note.text()))
