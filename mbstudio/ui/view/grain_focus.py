"""Looking at the chosen grains: slices and view go to them, zoom to them, or show them alone."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
from jaxtyping import Float
from PySide6.QtCore import QObject, QPoint, Qt, Signal
from PySide6.QtGui import QGuiApplication

from mbstudio.core.grains import GrainSet
from mbstudio.scene.layers.slices import AXES
from mbstudio.ui.studio import Studio
from mbstudio.ui.view.scene_view import SceneView

ADDING = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
"""Keys with which a click adds to the chosen grains."""
ROOM = 1.5
"""Size of what zooming shows, over that of the grains."""


class GrainFocus(QObject):
    """Brings the chosen grains before the eyes, and takes clicks on grains in slices and view.

    Parameters
    ----------
    studio : Studio
    view : SceneView

    Attributes
    ----------
    isolated : bool
        Whether the chosen grains are shown alone.
    isolation_changed : signal
    region_asked : signal (dict of Axis to tuple of int)
        The flat slices are to show these voxels large.
    """

    isolation_changed = Signal()
    region_asked = Signal(object)

    def __init__(self, studio: Studio, view: SceneView) -> None:
        super().__init__(studio)
        self._studio, self._view, self._space = studio, view, studio.workspace
        self._followed: int | None = None
        self._space.selection_changed.connect(self.follow)
        view.entered.connect(self.follow)
        studio.grain_asked.connect(self.centre)
        studio.viewport.clicked.connect(self._clicked)
        studio.viewport.menu_asked.connect(self._menu_asked)

    # ---- clicks --------------------------------------------------------------------------------

    def _clicked(self, x: float, y: float) -> None:
        if not self._view.picking:
            return
        label, layers = self._label_under(x, y), self._view.scene.layers
        # Beside a grain that is looked at by itself there is nothing that could be meant.
        if label is not None or layers.grains.is_shown or layers.avatars.is_shown:
            self.take(label)

    def _menu_asked(self, x: float, y: float, place: QPoint) -> None:
        if self._view.picking:
            self._studio.grain_menu.open(self._label_under(x, y), place)

    def take(self, label: int | None) -> None:
        """Choose a grain that was clicked, or none; with Ctrl or Shift add it to the others."""
        if not QGuiApplication.keyboardModifiers() & ADDING:
            self._space.select(label)
        elif label is not None:
            self._space.toggle([label])

    def label_at(self, voxel: tuple[int, int, int]) -> int | None:
        """Return the grain at a voxel (z, y, x) of what is sliced, or None."""
        grains = self._sliced_grains()
        inside = grains is not None and all(
            0 <= at < count for at, count in zip(voxel, grains.label_volume.shape, strict=True)
        )
        return (int(grains.label_volume[voxel]) or None) if grains is not None and inside else None

    def _label_under(self, x: float, y: float) -> int | None:
        """Return the grain under a pixel of the view: of an overview, the one looked at, or in a slice."""
        hit = self._view.scene.pick_grain(x, y)
        if hit is None or hit.label is not None:
            return None if hit is None else hit.label
        slices = self._view.scene.layers.slices.planes
        if hit.layer != "slices" or slices is None:
            return self._space.selected
        column, row, depth = slices.voxel_at(hit.point)
        return self.label_at((depth, row, column))

    # ---- where it is -----------------------------------------------------------------------------

    def follow(self) -> None:
        """Move the slices to the grain that is looked at, unless they cut it already."""
        label, slices = self._space.selected, self._view.scene.layers.slices.planes
        grains = self._sliced_grains()
        if label is None or grains is None or slices is None or self._view.slice_tool is not None:
            return
        if not (self._view.display.shows_slices or self._view.display.is_shown("slices")):
            return
        here = (slices.index["z"], slices.index["y"], slices.index["x"])
        if not grains.has(label) or (self.label_at(here) == label and not self._space.slices_voxels):
            return
        low, high = _ends(grains, (label,))
        x, y, z = ((low + high) // 2).astype(int).tolist()
        if self.label_at((z, y, x)) != label and not self._space.slices_voxels:
            z, y, x = grains.voxel_inside(label)
        self._view.move_slices({"x": x, "y": y, "z": z})

    def zoom(self) -> None:
        """Show the chosen grains large, in the view and in the flat slices."""
        self.follow()
        grains, labels = self._space.state.grains, self._space.chosen
        if grains is None or not labels:
            return
        low, high = _ends(grains, labels)
        edges, origin = np.array(grains.voxel_size.xyz), np.array(grains.origin)
        if not self._view.display.own_space:
            ends = origin + (np.array([low, high]) - 0.5) * edges
            corners = np.array([(x, y, z) for x in ends[:, 0] for y in ends[:, 1] for z in ends[:, 2]])
            self._view.frame(corners, ROOM)
        if self._sliced_grains() is not None:
            first, last = low.astype(int).tolist(), high.astype(int).tolist()
            self.region_asked.emit(dict(zip(AXES, zip(first, last, strict=True), strict=True)))

    def centre(self) -> None:
        """Move the grain that is looked at into the middle of the view, without zooming."""
        grains, label = self._space.state.grains, self._space.selected
        if grains is None or label is None or self._view.display.own_space:
            return
        low, high = _ends(grains, (label,))
        self._view.centre(np.array(grains.origin) + ((low + high) / 2 - 0.5) * grains.voxel_size.xyz)

    # ---- alone -----------------------------------------------------------------------------------

    @property
    def isolated(self) -> bool:
        return self._view.scene.isolated

    def isolate(self, on: bool) -> None:
        """Show the chosen grains alone, in the view and as outlines in the slices, or all again."""
        self._view.scene.isolate(on)
        self.isolation_changed.emit()
        self._view.draw()

    # ---- inside ----------------------------------------------------------------------------------

    def _sliced_grains(self) -> GrainSet | None:
        """Return the grains if they lie in what is sliced, voxel by voxel."""
        grains, scan = self._space.state.grains, self._space.sliced
        fits = grains is not None and scan is not None and grains.label_volume.shape == scan.shape
        return grains if fits else None


def _ends(grains: GrainSet, labels: Collection[int]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Return the box of grains in voxels (x, y, z), half open."""
    rows = grains.table.loc[grains.table["label"].isin(list(labels))]
    low = rows[[f"{axis}0" for axis in AXES]].to_numpy(float).min(axis=0)
    return low, rows[[f"{axis}1" for axis in AXES]].to_numpy(float).max(axis=0)
