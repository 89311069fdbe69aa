"""Pictures of grains to click and to drag: strips of them, and the places that take a grain from a strip."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

from PySide6.QtCore import QByteArray, QMimeData, QSize, Qt, Signal
from PySide6.QtGui import (
    QDrag,
    QDragEnterEvent,
    QDragLeaveEvent,
    QDropEvent,
    QIcon,
    QImage,
    QKeyEvent,
    QMouseEvent,
    QPixmap,
)
from PySide6.QtWidgets import QAbstractItemView, QFrame, QLabel, QListView, QListWidget, QListWidgetItem
from PySide6.QtWidgets import QVBoxLayout as Column

from mbstudio.ui.deferred_calls import DeferredCalls
from mbstudio.ui.language import tr
from mbstudio.ui.widgets.forms import label

MIME = "application/x-mbstudio-grain"
SIDE = 72  # pixels of a picture
_NAME = Qt.ItemDataRole.UserRole


def pixmap_of(picture: object) -> QPixmap:
    """Return the pixmap of a picture of shape (h, w, 4); only in the main thread."""
    import numpy as np

    array = np.ascontiguousarray(picture)
    height, width, _ = array.shape
    return QPixmap.fromImage(
        QImage(array.data, width, height, 4 * width, QImage.Format.Format_RGBA8888).copy()
    )


class GrainStrip(QListWidget):
    """A row of grains, each with its picture and its name.

    Parameters
    ----------
    name : str
        For those who cannot see it.
    named_by_hand : bool
        Whether the grains can be called otherwise: F2, and :meth:`edit_chosen`.

    Attributes
    ----------
    opened : signal (str)
        A double click on a grain, or Enter.
    renamed : signal (str, str)
        A grain's name, and what it is to be called.
    """

    opened = Signal(str)
    renamed = Signal(str, str)

    def __init__(self, name: str, *, named_by_hand: bool = False) -> None:
        super().__init__()
        self._named_by_hand = named_by_hand
        self._deferred = DeferredCalls(self)
        triggers = QAbstractItemView.EditTrigger
        self.setEditTriggers(triggers.EditKeyPressed if named_by_hand else triggers.NoEditTriggers)
        self.itemChanged.connect(self._changed)
        self.setAccessibleName(name)
        self.setObjectName("grainStrip")
        self.setViewMode(QListView.ViewMode.IconMode)
        self.setFlow(QListView.Flow.LeftToRight)
        self.setWrapping(False)
        self.setMovement(QListView.Movement.Static)
        self.setIconSize(QSize(SIDE, SIDE))
        self.setGridSize(QSize(SIDE + 22, SIDE + 26))
        self.setDragEnabled(True)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setHorizontalScrollMode(QAbstractItemView.ScrollMode.ScrollPerPixel)
        self.setVerticalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setTextElideMode(Qt.TextElideMode.ElideMiddle)
        self.itemDoubleClicked.connect(lambda item: self.opened.emit(item.data(_NAME)))
        self.itemActivated.connect(lambda item: self.opened.emit(item.data(_NAME)))

    def set_grains(
        self, names: Sequence[str], pictures: Mapping[str, QPixmap], tips: Mapping[str, str]
    ) -> None:
        """Show other grains; the one that was chosen stays so."""
        chosen = self.chosen
        self.blockSignals(True)
        self.clear()
        for name in names:
            item = QListWidgetItem(name)
            item.setData(_NAME, name)
            item.setSizeHint(self.gridSize())
            item.setToolTip(tips.get(name, name))
            item.setTextAlignment(Qt.AlignmentFlag.AlignHCenter)
            if self._named_by_hand:
                item.setFlags(item.flags() | Qt.ItemFlag.ItemIsEditable)
            if name in pictures:
                item.setIcon(QIcon(pictures[name]))
            self.addItem(item)
            if name == chosen:
                self.setCurrentItem(item)
        self.blockSignals(False)

    def edit_chosen(self) -> None:
        """Let the name of the chosen grain be written anew."""
        if self.chosen is not None:
            self.editItem(self.currentItem())

    def _changed(self, item: QListWidgetItem) -> None:
        name = str(item.data(_NAME))
        if item.text() != name:
            # Not from within the editor, whose grain goes when the strip is filled anew.
            self._deferred.call(partial(self.renamed.emit, name, item.text()))

    def set_picture(self, name: str, picture: QPixmap) -> None:
        """Show a picture that was made meanwhile."""
        for place in range(self.count()):
            if self.item(place).data(_NAME) == name:
                self.item(place).setIcon(QIcon(picture))

    @property
    def names(self) -> list[str]:
        """Names of the grains shown."""
        return [str(self.item(place).data(_NAME)) for place in range(self.count())]

    @property
    def chosen(self) -> str | None:
        """Name of the grain that is chosen."""
        item = self.currentItem()
        return str(item.data(_NAME)) if item is not None and item.isSelected() else None

    def choose(self, name: str) -> None:
        """Choose a grain by its name."""
        for place in range(self.count()):
            if self.item(place).data(_NAME) == name:
                self.setCurrentRow(place)

    def startDrag(self, supported: Qt.DropAction) -> None:
        if self.chosen is None:
            return
        drag = QDrag(self)
        drag.setMimeData(grain_mime(self.chosen))
        drag.setPixmap(self.currentItem().icon().pixmap(SIDE, SIDE))
        drag.exec(Qt.DropAction.CopyAction)


def grain_mime(name: str) -> QMimeData:
    """Return what a dragged grain carries."""
    data = QMimeData()
    data.setData(MIME, QByteArray(name.encode()))
    return data


class GrainSlot(QFrame):
    """A place for one grain: drop one here, or click to put in the one that is chosen.

    Attributes
    ----------
    dropped : signal (str)
    clicked : signal
    """

    dropped = Signal(str)
    clicked = Signal()

    def __init__(self, letter: str, tip: str = "", side: int = SIDE) -> None:
        super().__init__()
        self.letter, self._side = letter, side
        self.setObjectName("grainSlot")
        self.setAcceptDrops(True)
        self.setFixedWidth(side + 24)
        self.setToolTip(tip)
        self.setAccessibleName(tr("Grain {letter}", letter=letter))
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.picture = QLabel()
        self.picture.setFixedSize(side, side)
        self.picture.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.name = label(letter, "hint")
        self.name.setAlignment(Qt.AlignmentFlag.AlignCenter)
        layout = Column(self)
        layout.setContentsMargins(4, 4, 4, 4)
        layout.setSpacing(0)
        layout.addWidget(self.picture, 0, Qt.AlignmentFlag.AlignHCenter)
        layout.addWidget(self.name)
        self.set_grain(None, None)

    def set_grain(self, name: str | None, picture: QPixmap | None) -> None:
        """Show a grain, or that there is none."""
        self.grain = name
        words = self.letter if name is None else f"{self.letter}: {name}" if self.letter else name
        metrics, room = self.name.fontMetrics(), self._side + 16
        self.name.setText(metrics.elidedText(words, Qt.TextElideMode.ElideMiddle, room))
        if picture is not None:
            keep, smooth = Qt.AspectRatioMode.KeepAspectRatio, Qt.TransformationMode.SmoothTransformation
            self.picture.setPixmap(picture.scaled(self._side, self._side, keep, smooth))
        else:
            self.picture.setText(tr("drop") if name is None and self.letter else "")

    def mousePressEvent(self, event: QMouseEvent) -> None:
        if event.button() == Qt.MouseButton.LeftButton:
            self.clicked.emit()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        if event.key() in (Qt.Key.Key_Return, Qt.Key.Key_Enter, Qt.Key.Key_Space):
            self.clicked.emit()
        else:
            super().keyPressEvent(event)

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if event.mimeData().hasFormat(MIME):
            event.acceptProposedAction()
            self._light(True)

    def dragLeaveEvent(self, event: QDragLeaveEvent) -> None:
        self._light(False)

    def dropEvent(self, event: QDropEvent) -> None:
        event.acceptProposedAction()
        self._light(False)
        self.dropped.emit(bytes(event.mimeData().data(MIME).data()).decode())

    def _light(self, on: bool) -> None:
        self.setProperty("over", "true" if on else "false")
        self.style().unpolish(self)
        self.style().polish(self)
