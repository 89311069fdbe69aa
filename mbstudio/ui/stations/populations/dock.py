"""The plots of populations with their tabs, legend and tools; words where there is nothing to draw."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from html import escape

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QButtonGroup,
    QFrame,
    QHBoxLayout,
    QLabel,
    QStackedWidget,
    QTabBar,
    QToolButton,
    QVBoxLayout,
)

from mbstudio.core.populations import LaboratoryCurve, Population
from mbstudio.scene.figures.population_style import colour_of
from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.stations.populations.plots import Counts, PopulationPlot, Shown, pages
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.comparison_table import name_of
from mbstudio.ui.widgets.forms import label

NARROWEST = 260
"""Pixels that plots need; the smallest window leaves no more beside panel and view."""
_SIGNS = ("●", "▲", "■")


class PopulationDock(QFrame):
    """Pages of plots, one at a time.

    Attributes
    ----------
    brushed : signal (list of int, bool)
        Labels that were chosen in a plot, and whether to add them.
    menu_asked : signal (int or None, QPoint)
        Label of a point that was clicked with the right button, and the place on the screen.
    """

    brushed = Signal(object, bool)
    menu_asked = Signal(object, object)

    def __init__(self, theme: Theme, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("plots")
        self.setMinimumWidth(NARROWEST)
        self._theme = theme
        self._populations: Sequence[Population] = ()
        self._is_growing = False
        self._shown = Shown()
        self._tables: Sequence[LaboratoryCurve] = ()
        self._counts: Counts = {}
        self._marked: tuple[Collection[int], int | None] = ((), None)
        self.pages: dict[str, PopulationPlot] = {}
        self.tabs = QTabBar()
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.setAccessibleName(tr("Kind of plot"))
        self._stack = QStackedWidget()
        for name, (title, page) in pages(theme).items():
            self.tabs.addTab(title)
            self._stack.addWidget(page)
            self.pages[name] = page
            page.brushed.connect(self.brushed)
            page.menu_asked.connect(self.menu_asked)
        self.words = QLabel()
        self.words.setObjectName("emptyPlot")
        self.words.setWordWrap(True)
        self.words.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.words.setContentsMargins(40, 0, 40, 0)
        self._stack.addWidget(self.words)
        self._legend = label("", "hint", wrap=True)
        self._legend.setTextFormat(Qt.TextFormat.RichText)
        self._tools(icons)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.tabs)
        layout.addLayout(self._tool_line)
        layout.addWidget(self._stack, 1)
        self.tabs.currentChanged.connect(self._turn)
        theme.changed.connect(self._write_legend)
        self.say("")

    def _tools(self, icons: Icons) -> None:
        self.rectangle, self.lasso = QToolButton(), QToolButton()
        self.everything, self.save, self.copy = QToolButton(), QToolButton(), QToolButton()
        self._tool_line = QHBoxLayout()
        self._tool_line.setContentsMargins(14, 2, 8, 0)
        self._tool_line.setSpacing(2)
        self._tool_line.addWidget(self._legend, 1)
        for button, icon, words in (
            (self.rectangle, "ph.selection", tr("Select by dragging a rectangle")),
            (self.lasso, "ph.scribble-loop", tr("Select by drawing a lasso")),
            (self.everything, "ph.frame-corners", tr("Show the whole plot")),
            (self.copy, "ph.copy", tr("Copy the figure as a picture")),
            (self.save, "ph.download-simple", tr("Save the figure (SVG, PNG, PDF)…")),
        ):
            icons.set(button, icon)
            button.setToolTip(words)
            button.setAccessibleName(words)
            button.setFocusPolicy(Qt.FocusPolicy.TabFocus)
            self._tool_line.addWidget(button)
        modes = QButtonGroup(self)
        for button in (self.rectangle, self.lasso):
            button.setCheckable(True)
            modes.addButton(button)
        self.rectangle.setChecked(True)
        self.lasso.toggled.connect(self._set_mode)
        self.everything.clicked.connect(lambda: self.page.show_everything())

    def _set_mode(self, lasso: bool) -> None:
        for page in self.pages.values():
            page.set_mode("lasso" if lasso else "rectangle")

    # ---- what is shown -------------------------------------------------------------------------

    @property
    def page_name(self) -> str:
        """Name of the page that is looked at."""
        return list(self.pages)[self.tabs.currentIndex()]

    @property
    def page(self) -> PopulationPlot:
        """The page that is looked at."""
        return self.pages[self.page_name]

    def open_page(self, name: str) -> None:
        """Turn to a page."""
        self.tabs.setCurrentIndex(list(self.pages).index(name))

    def show_populations(
        self,
        populations: Sequence[Population],
        shown: Shown,
        is_growing: bool = False,
        tables: Sequence[LaboratoryCurve] = (),
        counts: Counts | None = None,
    ) -> None:
        """Draw populations; those of the other pages when they are turned to.

        The legend says of those that are growing that more is to come.
        """
        self._populations, self._shown, self._is_growing = populations, shown, is_growing
        self._tables, self._counts = tables, counts or {}
        self._write_legend()
        self._turn()

    def show_certainty(self, shown: Shown) -> None:
        """Draw bands about what is drawn."""
        self._shown = shown
        if self._populations:
            self.page.show_certainty(shown)
            self.page.mark(*self._marked)

    def say(self, words: str) -> None:
        """Say what to do while there is nothing to draw."""
        self.words.setText(words)
        self._turn()

    def mark(self, labels: Collection[int], current: int | None) -> None:
        """Bring out bodies by their labels."""
        self._marked = labels, current
        self.page.mark(labels, current)

    def _turn(self, *_: object) -> None:
        drawn = bool(self._populations)
        self._stack.setCurrentWidget(self.page if drawn else self.words)
        for part in (self.rectangle, self.lasso, self.everything):
            part.setEnabled(drawn)
        for part in (self.save, self.copy):
            part.setEnabled(drawn and not self._is_growing)
        if drawn:
            self.page.show_populations(self._populations, self._shown, self._tables, self._counts)
            self.page.mark(*self._marked)

    def _write_legend(self) -> None:
        parts = [
            f'<span style="color:{colour_of(population, self._theme.scene)}">{_SIGNS[place % 3]}</span> '
            f"{escape(name_of(population))} ({int(population.measured.sum())})"
            for place, population in enumerate(self._populations)
        ]
        if self._is_growing:
            parts.append(escape(tr("so far; more is to come")))
        self._legend.setText(" &nbsp; ".join(parts))
