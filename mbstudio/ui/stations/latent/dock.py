"""Beside the view at station Latent: factors, blending and the map as pages."""

from __future__ import annotations

from PySide6.QtWidgets import QFrame, QHBoxLayout, QStackedWidget, QTabBar, QVBoxLayout, QWidget

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.latent.blend_page import BlendPage
from mbstudio.ui.stations.latent.factor_radar import FactorPage
from mbstudio.ui.stations.latent.map_plot import LatentMapPlot
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import label, scrolling

PAGES = (mark("Factors"), mark("Blend"), mark("Map"))


class LatentDock(QFrame):
    """Pages about the grain under the hand, one at a time."""

    def __init__(self, theme: Theme, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("plots")
        self.setMinimumWidth(392)
        self.factors, self.blend, self.map = FactorPage(theme), BlendPage(icons), LatentMapPlot(theme)
        self.tabs = QTabBar()
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.setAccessibleName(tr("Page of the latent studio"))
        self._stack = QStackedWidget()
        pages: tuple[QWidget, ...] = (self.factors, self.blend, self.map)
        for title, page in zip(PAGES, pages, strict=True):
            self.tabs.addTab(tr(title))
            self._stack.addWidget(scrolling(page) if page is not self.map else _explained(page))
        self.tabs.currentChanged.connect(self._stack.setCurrentIndex)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.tabs)
        layout.addWidget(self._stack, 1)

    def open_page(self, title: str) -> None:
        """Turn to a page: Factors, Blend or Map."""
        self.tabs.setCurrentIndex(PAGES.index(title))


def _explained(plot: QWidget) -> QWidget:
    """Return the map with what its marks mean below it."""
    page = QWidget()
    layout = QVBoxLayout(page)
    layout.setContentsMargins(0, 0, 0, 10)
    layout.setSpacing(6)
    layout.addWidget(plot, 1)
    line = QHBoxLayout()
    line.setContentsMargins(14, 0, 14, 0)
    line.addWidget(
        label(
            tr(
                "Small dots: parents. Rings: clones. Squares: kept grains. Large dot: the current "
                "grain. Click to show the grain there, or drag to follow the pointer."
            ),
            "hint",
            wrap=True,
        )
    )
    layout.addLayout(line)
    return page
