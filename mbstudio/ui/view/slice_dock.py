"""The three slices of a scan as flat pictures, one below the other."""

from __future__ import annotations

from PySide6.QtWidgets import QFrame, QVBoxLayout

from mbstudio.scene.layers.slices import AXES, Axis
from mbstudio.ui.theme import Theme
from mbstudio.ui.view.slice_pane import SlicePane

PLANES: tuple[tuple[str, Axis], ...] = (("XY", "z"), ("XZ", "y"), ("YZ", "x"))
"""Of each pane: its plane, and the axis that it cuts."""


def axes_of(plane: str) -> tuple[Axis, Axis]:
    """Return the axes of a plane, to the right and upwards."""
    first, second = (axis for axis in AXES if axis in plane.lower())
    return first, second


class SliceDock(QFrame):
    """Panes XY, XZ and YZ.

    Parameters
    ----------
    theme : Theme
    """

    def __init__(self, theme: Theme) -> None:
        super().__init__()
        self.setObjectName("plots")
        self._theme = theme
        self.panes = {across: SlicePane(plane, across) for plane, across in PLANES}
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(0)
        for pane in self.panes.values():
            layout.addWidget(pane, 1)
        theme.changed.connect(self.recolour)
        self.recolour()

    def recolour(self) -> None:
        """Take the theme's colours: each line has that of the slice's frame in the 3-D view."""
        colour = dict(zip(AXES, self._theme.scene.axes, strict=True))
        ground = self._theme.tokens.surface
        for (plane, across), pane in zip(PLANES, self.panes.values(), strict=True):
            first, second = axes_of(plane)
            # The upright line is the slice across the first axis.
            pane.box.colour = self._theme.scene.grain
            pane.set_colours(colour[across], colour[first], colour[second], ground)
