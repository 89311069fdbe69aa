"""Beside the view at station Latent, where grains are shaped from surfaces: map and design as pages."""

from __future__ import annotations

from PySide6.QtWidgets import QFrame, QStackedWidget, QTabBar, QVBoxLayout

from mbstudio.ui.language import mark, tr
from mbstudio.ui.stations.latent.surface_design_page import SurfaceDesignPage
from mbstudio.ui.stations.latent.surface_map import SurfaceMap
from mbstudio.ui.stations.latent.surface_work import SurfaceWork
from mbstudio.ui.theme import Theme
from mbstudio.ui.widgets.forms import scrolling

_PAGES = (mark("Map"), mark("Design"))


class SurfaceDock(QFrame):
    """Pages about a grain that is shaped from surfaces, one at a time."""

    def __init__(self, work: SurfaceWork, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("plots")
        self.setMinimumWidth(360)
        self.map, self.design = SurfaceMap(work, theme), SurfaceDesignPage(work)
        self.tabs = QTabBar()
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.setAccessibleName(tr("Page of the latent studio"))
        stack = QStackedWidget()
        for title, page in zip(_PAGES, (self.map, scrolling(self.design)), strict=True):
            self.tabs.addTab(tr(title))
            stack.addWidget(page)
        self.tabs.currentChanged.connect(stack.setCurrentIndex)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addWidget(self.tabs)
        layout.addWidget(stack, 1)

    def open_page(self, title: str) -> None:
        """Turn to a page: Map or Design."""
        self.tabs.setCurrentIndex(_PAGES.index(title))
