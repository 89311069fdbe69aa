"""Words over the 3-D view while its surfaces are built: an empty view is not to be taken for a fault."""

from __future__ import annotations

from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtWidgets import QLabel

from mbstudio.ui.language import tr
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView

_AFTER = 250  # milliseconds: what is built sooner needs no words
_EDGE = 14  # pixels


class BuildingNote(QObject):
    """Says what is being built, and why there is no deviation to be seen.

    Parameters
    ----------
    studio : Studio
    view : SceneView

    Attributes
    ----------
    label : QLabel
    """

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio)
        self._studio, self._view = studio, view
        self.label = QLabel(studio.viewport)
        self.label.setObjectName("note")
        self.label.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self.label.hide()
        self._soon = QTimer(self)
        self._soon.setSingleShot(True)
        self._soon.setInterval(_AFTER)
        self._soon.timeout.connect(self.refresh)
        studio.queue.changed.connect(self._queue_changed)
        view.arranged.connect(self.refresh)
        studio.viewport.installEventFilter(self)

    @property
    def text(self) -> str:
        """The words that are shown, or nothing."""
        return self.label.text() if not self.label.isHidden() else ""

    def refresh(self) -> None:
        """Show what there is to be said."""
        words = self._words()
        self.label.setText(words)
        self.label.setVisible(bool(words))
        self.label.adjustSize()
        self._place()

    def _words(self) -> str:
        task = self._studio.queue.running("view")
        if task is not None and not self._soon.isActive():
            return f"{task.title} …"
        space, view = self._studio.workspace, self._view
        label = space.selected
        if view.is_shown("deviation") and label is not None and label not in space.state.fits:
            return tr("Grain {label} has no avatar yet, so there is no deviation to be seen.", label=label)
        return ""

    def _queue_changed(self) -> None:
        if self._studio.queue.running("view") is None:
            self._soon.stop()
            self.refresh()
        elif not self._soon.isActive():
            self._soon.start()

    def _place(self) -> None:
        self.label.move(_EDGE, self._studio.viewport.height() - self.label.height() - 4 * _EDGE)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() == QEvent.Type.Resize:
            self._place()
        return super().eventFilter(watched, event)
