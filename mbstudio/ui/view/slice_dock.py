"""The three slices of a scan as flat pictures, one below the other, and the bar above them."""

from __future__ import annotations

from PySide6.QtWidgets import QFrame, QVBoxLayout

from mbstudio.scene.layers.slices import AXES, Axis
from mbstudio.ui.theme import Theme
from mbstudio.ui.view.slice_bar import SliceBar
from mbstudio.ui.view.slice_pane import SlicePane

PLANES: tuple[tuple[str, Axis], ...] = (("XY", "z"), ("XZ", "y"), ("YZ", "x"))
"""Of each pane: its plane, and the axis that it cuts."""


def axes_of(plane: str) -> tuple[Axis, Axis]:
    """Return the axes of a plane, to the right and upwards."""
    first, second = (axis for axis in AXES if axis in plane.lower())
    return first, second


class SliceDock(QFrame):
    """Panes XY, XZ and YZ; some of them, and the bar, may stand in the middle of the window instead.

    Parameters
    ----------
    theme : Theme

    Attributes
    ----------
    panes : dict of Axis to SlicePane
    bar : SliceBar
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("plots")
        self._theme = theme
        self.panes = {across: SlicePane(plane, across) for plane, across in PLANES}
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        self.bar = SliceBar()
        layout.addWidget(self.bar)
        self._column = layout
        for pane in self.panes.values():
            layout.addWidget(pane, 1)
        theme.changed.connect(self.recolour)
        self.recolour()

    def take(self, axes: set[Axis], with_bar: bool) -> None:
        """Take panes back, in their order, and the bar."""
        for place, (axis, pane) in enumerate(self.panes.items(), 1):
            if axis in axes:
                self._column.insertWidget(min(place, self._column.count()), pane, 1)
                pane.show()
        if with_bar:
            self._column.insertWidget(0, self.bar)
            self.bar.show()

    def recolour(self) -> None:
        """Take the theme's colours: each line has that of the slice's frame in the 3-D view."""
        colour = dict(zip(AXES, self._theme.scene.axes, strict=True))
        ground = self._theme.tokens.surface
        for (plane, across), pane in zip(PLANES, self.panes.values(), strict=True):
            first, second = axes_of(plane)
            # The upright line is the slice across the first axis.
            pane.box.colour = self._theme.scene.grain
            pane.set_colours(colour[across], colour[first], colour[second], ground)
