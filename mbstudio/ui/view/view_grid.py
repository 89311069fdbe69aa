"""The middle of the window: the 3-D view, alone or in a square with the three slices, or one of the four."""

from __future__ import annotations

from collections.abc import Mapping

from PySide6.QtWidgets import QGridLayout, QWidget

from mbstudio.scene.layers.slices import Axis
from mbstudio.ui.view.slice_dock import SliceDock
from mbstudio.ui.view.slice_pane import SlicePane
from mbstudio.ui.viewport.viewport import Viewport

CELLS: Mapping[Axis, tuple[int, int]] = {"z": (1, 0), "x": (1, 1), "y": (2, 0)}
VIEW_CELL = (2, 1)
GAP = 2  # pixels between the four


class ViewGrid(QWidget):
    """Holds the 3-D view and, where they are asked for, panes.

    Parameters
    ----------
    viewport : Viewport
    dock : SliceDock
        Where the panes are otherwise.
    """

    def __init__(self, viewport: Viewport, dock: SliceDock) -> None:
        super().__init__()
        self._viewport, self._dock = viewport, dock
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setSpacing(GAP)
        self._grid.addWidget(viewport, *VIEW_CELL)
        self._panes: Mapping[Axis, SlicePane] = dock.panes
        self._shown: tuple[bool, str] = (False, "")

    def arrange(self, squared: bool, enlarged: str) -> None:
        """Show the 3-D view alone, or all four, or one of them.

        Parameters
        ----------
        squared : bool
            Whether the slices stand beside the view, and not in their dock.
        enlarged : str
            The axis of the pane that is as large as all four, "view" for the 3-D view, or nothing.
        """
        if (squared, enlarged) == self._shown:
            return
        self._shown = (squared, enlarged)
        here = set(CELLS) if squared else {axis for axis in CELLS if axis == enlarged}
        self._dock.take(set(CELLS) - here, with_bar=not squared)
        if squared:
            self._grid.addWidget(self._dock.bar, 0, 0, 1, 2)
            self._dock.bar.show()
        for axis, cell in CELLS.items():
            if axis in here:
                self._grid.addWidget(self._panes[axis], *cell)
                self._panes[axis].setVisible(enlarged in ("", axis))
        self._viewport.setVisible(enlarged in ("", "view"))
        for row in (1, 2):
            self._grid.setRowStretch(row, int(self._is_taken(0, row)))
        for column in (0, 1):
            self._grid.setColumnStretch(column, int(self._is_taken(1, column)))

    def _is_taken(self, side: int, line: int) -> bool:
        """Whether a row (side 0) or a column (side 1) holds something that is seen."""
        squared, enlarged = self._shown
        for axis, cell in CELLS.items():
            if axis == enlarged:
                return cell[side] == line
        return VIEW_CELL[side] == line or (squared and not enlarged)
