"""Below the view at station Latent: kept grains and parents, to click and to drag."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from PySide6.QtCore import Signal
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QFrame, QTabBar, QToolButton, QVBoxLayout
from PySide6.QtWidgets import QHBoxLayout as Line

from mbstudio.ui.icons import Icons
from mbstudio.ui.widgets.grain_strip import GrainStrip


class Gallery(QFrame):
    """Two strips of grains, one at a time.

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
        self.setObjectName("gallery")
        self.kept, self.parents = GrainStrip("Kept grains", named_by_hand=True), GrainStrip("Parents")
        self.tabs = QTabBar()
        self.tabs.setExpanding(False)
        self.tabs.setDrawBase(False)
        self.tabs.addTab("Parents")
        self.tabs.addTab("Kept grains")
        self.tabs.setAccessibleName("Which grains")
        self.remove = QToolButton()
        icons.set(self.remove, "ph.trash")
        self.remove.setToolTip("Take the chosen kept grain out of the gallery")
        self.remove.setAccessibleName("Remove")
        self.rename = QToolButton()
        icons.set(self.rename, "ph.pencil-simple")
        self.rename.setToolTip("Call the chosen kept grain otherwise (F2)")
        self.rename.setAccessibleName("Rename")
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
        for strip in (self.parents, self.kept):
            layout.addWidget(strip, 1)
            strip.opened.connect(self.opened)
            strip.currentRowChanged.connect(lambda _: self._refresh())
        self.setFixedHeight(154)
        self.tabs.currentChanged.connect(lambda _: self._refresh())
        self.remove.clicked.connect(self._forget)
        self.rename.clicked.connect(self.kept.edit_chosen)
        self.kept.renamed.connect(self.rename_asked)
        self._refresh()

    @property
    def strip(self) -> GrainStrip:
        """The strip that is looked at."""
        return self.kept if self.tabs.currentIndex() == 1 else self.parents

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
        """Show other grains; a newly kept one turns the gallery to the kept grains."""
        grown = len(kept) > self.kept.count()
        self.kept.set_grains(kept, pictures, tips)
        if self.parents.names != list(parents):
            self.parents.set_grains(parents, pictures, {})
        self.tabs.setTabText(0, f"Parents ({len(parents)})")
        self.tabs.setTabText(1, f"Kept grains ({len(kept)})")
        if grown:
            self.tabs.setCurrentIndex(1)
            self.kept.scrollToBottom()
        elif not kept:
            self.tabs.setCurrentIndex(0)
        self._refresh()

    def set_picture(self, name: str, picture: QPixmap) -> None:
        """Show a picture that was made meanwhile."""
        for strip in (self.kept, self.parents):
            strip.set_picture(name, picture)

    def _refresh(self) -> None:
        self.kept.setVisible(self.strip is self.kept)
        self.parents.setVisible(self.strip is self.parents)
        for button in (self.rename, self.remove):
            button.setVisible(self.strip is self.kept)
            button.setEnabled(self.kept.chosen is not None)

    def _forget(self) -> None:
        if self.kept.chosen is not None:
            self.forget_asked.emit(self.kept.chosen)
