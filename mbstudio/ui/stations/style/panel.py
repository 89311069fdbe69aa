"""Station Style: the form of grains is learned, and new ones are generated in it (MetaballVAE)."""

from __future__ import annotations

from PySide6.QtWidgets import QTabBar

from mbstudio.ui.language import tr
from mbstudio.ui.stations.panel import Panel
from mbstudio.ui.stations.style.clone_work import CloneWork
from mbstudio.ui.stations.style.generate_page import GeneratePage
from mbstudio.ui.stations.style.learn_page import LearnPage
from mbstudio.ui.stations.style.work import StyleWork
from mbstudio.ui.workspace import Workspace


class StylePanel(Panel):
    """Two pages, to learn and to generate, each with its buttons at the foot."""

    def __init__(self, workspace: Workspace, styles: StyleWork, clones: CloneWork) -> None:
        super().__init__(
            tr("Style"), tr("MetaballVAE learns the shape of grains and generates new ones like them.")
        )
        self.learn = LearnPage(workspace, styles)
        self.generate = GeneratePage(workspace, clones)
        self.tabs = QTabBar()
        self.tabs.setExpanding(True)
        self.tabs.setDrawBase(False)
        self.tabs.setAccessibleName(tr("Learn or generate"))
        self.tabs.addTab(tr("Learn"))
        self.tabs.addTab(tr("Generate"))
        self.add(self.tabs, self.learn, self.generate)
        self.body.addStretch(1)
        self.foot.addWidget(self.learn.foot)
        self.foot.addWidget(self.generate.foot)
        self.tabs.currentChanged.connect(self._turn)
        self._turn(0)

    def open_page(self, name: str) -> None:
        """Turn to 'learn' or 'generate'."""
        self.tabs.setCurrentIndex(("learn", "generate").index(name))

    def _turn(self, place: int) -> None:
        pages: tuple[LearnPage | GeneratePage, ...] = (self.learn, self.generate)
        for index, page in enumerate(pages):
            page.setVisible(index == place)
            page.foot.setVisible(index == place)
