"""Below the view at station Latent: parents, kept grains and clones, to click and to drag."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from PySide6.QtCore import Signal
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QFrame, QTabBar, QToolButton, QVBoxLayout
from PySide6.QtWidgets import QHBoxLayout as Line

from mbstudio.ui.icons import Icons
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.grain_strip import GrainStrip

_CLONES = 2  # their tab


class Shelf(QFrame):
    """Three strips of grains, one at a time.

    Attributes
    ----------
    opened : signal (str)
        A grain is to be taken under the hand.
    forget_asked : signal (str)
        A kept grain is to go.
    rename_asked : signal (str, str)
        A kept grain is to be called otherwise.
    """

    opened = Signal(str)
    forget_asked = Signal(str)
    rename_asked = Signal(str, str)

    def __init__(self, icons: Icons) -> None:
        super().__init__()
        self.setObjectName("shelf")
        self.kept, self.parents = GrainStrip(tr("Kept grains"), named_by_hand=True), GrainStrip(tr("Parents"))
        self.clones = GrainStrip(tr("Clones"))
        self.tabs = QTabBar()
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.addTab(tr("Parents"))
        self.tabs.addTab(tr("Kept grains"))
        self.tabs.addTab(tr("Clones"))
        self.tabs.setTabVisible(_CLONES, False)
        self.tabs.setAccessibleName(tr("Which grains"))
        self.remove = QToolButton()
        icons.set(self.remove, "ph.trash")
        self.remove.setToolTip(tr("Remove the selected kept grain from the shelf"))
        self.remove.setAccessibleName(tr("Remove"))
        self.rename = QToolButton()
        icons.set(self.rename, "ph.pencil-simple")
        self.rename.setToolTip(tr("Rename the selected kept grain (F2)"))
        self.rename.setAccessibleName(tr("Rename"))
        head = Line()
        head.setContentsMargins(0, 0, 8, 0)
        head.addWidget(self.tabs)
        head.addStretch(1)
        head.addWidget(self.rename)
        head.addWidget(self.remove)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        layout.addLayout(head)
        for strip in self._strips:
            layout.addWidget(strip, 1)
            strip.opened.connect(self.opened)
            strip.currentRowChanged.connect(lambda _: self._refresh())
        self.setFixedHeight(154)
        self.tabs.currentChanged.connect(lambda _: self._refresh())
        self.kept.renamed.connect(self.rename_asked)
        self._refresh()

    @property
    def strip(self) -> GrainStrip:
        """The strip that is looked at."""
        return self._strips[max(self.tabs.currentIndex(), 0)]

    @property
    def _strips(self) -> tuple[GrainStrip, GrainStrip, GrainStrip]:
        return self.parents, self.kept, self.clones

    @property
    def chosen(self) -> str | None:
        """Name of the grain that is chosen in it."""
        return self.strip.chosen

    def show_grains(
        self,
        kept: Sequence[str],
        parents: Sequence[str],
        pictures: Mapping[str, QPixmap],
        tips: Mapping[str, str],
    ) -> None:
        """Show other grains; a newly kept one turns the shelf to the kept grains."""
        grown = len(kept) > self.kept.count()
        self.kept.set_grains(kept, pictures, tips)
        if self.parents.names != list(parents):
            self.parents.set_grains(parents, pictures, {})
        self.tabs.setTabText(0, tr("Parents ({count})", count=len(parents)))
        self.tabs.setTabText(1, tr("Kept grains ({count})", count=len(kept)))
        if grown:
            self.tabs.setCurrentIndex(1)
            self.kept.scrollToBottom()
        elif not kept and self.strip is self.kept:
            self.tabs.setCurrentIndex(0)
        self._refresh()

    def show_clones(self, names: Sequence[str], pictures: Mapping[str, QPixmap]) -> None:
        """Show other clones; without any there is no strip of them."""
        self.clones.set_grains(names, pictures, {})
        self.tabs.setTabText(_CLONES, tr("Clones ({count})", count=len(names)))
        if not names and self.strip is self.clones:
            self.tabs.setCurrentIndex(0)
        self.tabs.setTabVisible(_CLONES, bool(names))
        self._refresh()

    def set_picture(self, name: str, picture: QPixmap) -> None:
        """Show a picture that was made meanwhile."""
        for strip in self._strips:
            strip.set_picture(name, picture)

    def _refresh(self) -> None:
        for strip in self._strips:
            strip.setVisible(strip is self.strip)
        for button in (self.rename, self.remove):
            button.setVisible(self.strip is self.kept)

    def rename_chosen(self) -> None:
        """Let the person write another name for the chosen kept grain."""
        self.kept.edit_chosen()

    def remove_chosen(self) -> None:
        """Take the chosen kept grain away."""
        if self.kept.chosen is not None:
            self.forget_asked.emit(self.kept.chosen)
